//! What the recorder and the hand complain of, for the operator, who reads their logs as little as their pages: once when the recording stands still or the
//! gamepad is gone, and once when that is over.

use super::Supervisor;
use crate::journal::Seldom;
use hyst_exchange::ReadPage;
use hyst_messages::page::{header, recorder as layout};
use hyst_messages::{Role, Slot};

/// What was said of the recording.
#[derive(Debug, Default)]
pub struct Complaint {
    /// When it was first seen to stand still, ns; `None` while it goes on.
    since_ns: Option<u64>,
    /// A disk that is full now and then is said now and then.
    said: Seldom,
    hand: Hand,
}

/// What was said of whoever holds the scope.
#[derive(Debug, Default)]
struct Hand {
    complains: bool,
    /// A plug that is loose is said now and then.
    said: Seldom,
}

impl Hand {
    /// What is to be said after a look at the hardware that lives.
    fn look(&mut self, words: &str) -> Option<String> {
        // What is no text nobody said.
        let words =
            if words.chars().any(|letter| letter.is_control() || letter == char::REPLACEMENT_CHARACTER) { "" } else { words };
        let complained = std::mem::replace(&mut self.complains, !words.is_empty());
        match (complained, self.complains) {
            (false, true) => Some(words.to_owned()),
            (true, false) => Some("the hand has its device again".to_owned()),
            _ => None,
        }
    }
}

impl Complaint {
    /// What is to be said after a look at the recorder that lives: what it complains of, when the disk last took something of it, ns, and the ticks that it lost.
    fn look(&mut self, now_ns: u64, words: &str, written_ns: u64, lost: u64) -> Option<String> {
        match self.since_ns {
            None if !words.is_empty() => {
                self.since_ns = Some(now_ns);
                Some(format!("the recording stands still: {words}"))
            }
            // A successor complains of nothing as long as it has not tried.
            Some(since_ns) if words.is_empty() && written_ns > since_ns => {
                self.since_ns = None;
                let gone = if lost > 0 { format!("{lost} ticks are lost") } else { "nothing is lost".into() };
                Some(format!("the recording goes on, {gone}"))
            }
            _ => None,
        }
    }
}

impl Supervisor {
    /// The page of one that is ready. What one that is dead left are its last words, and are said with its death.
    fn page_of_living(&mut self, slot: Slot) -> Option<&ReadPage> {
        if self.viewer.page().is_dead(slot) {
            return None;
        }
        self.viewer.slot_page(slot).filter(|page| page.state().is_ready())
    }

    /// Says it when the hand's complaint begins, and when it is over.
    pub(super) fn heed_hand(&mut self, now_ns: u64) {
        let Some(page) = self.page_of_living(Slot::first(Role::Hardware)) else { return };
        let words = page.last_words();
        if let Some(text) = self.complaint.hand.look(&words) {
            self.complaint.hand.said.say(&self.station, now_ns, &text);
        }
    }

    /// Says it when the recorder's complaint begins, and when it is over.
    pub(super) fn heed_recorder(&mut self, now_ns: u64) {
        let Some(page) = self.page_of_living(Slot::first(Role::Recorder)) else { return };
        let (words, written_ns) = (page.last_words(), page.load64(header::VALUE_NS));
        let lost = page.cell(layout::STATUS).map_or(0, |(_, status)| status.lost);
        if let Some(text) = self.complaint.look(now_ns, &words, written_ns, lost) {
            self.complaint.said.say(&self.station, now_ns, &text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_whose_device_is_gone_is_said_once_and_that_it_is_there_again_once_also_by_a_successor() {
        let mut hand = Hand::default();
        let said = ["", "it is gone", "it is gone", "", "", "it is gone"].map(|words| hand.look(words));
        let again = Some("the hand has its device again".to_owned());
        let gone = Some("it is gone".to_owned());
        assert_eq!(said, [None, gone.clone(), None, again, None, gone]);
        assert_eq!(["\u{1}", "\u{fffd}x", ""].map(|words| Hand::default().look(words)), [None, None, None], "flipped bits");
    }

    #[test]
    fn a_recording_that_stands_still_is_said_once_and_that_it_goes_on_once_something_was_written() {
        let mut complaint = Complaint::default();
        assert_eq!(complaint.look(100, "", 90, 0), None);
        assert_eq!(complaint.look(200, "no room", 90, 0).as_deref(), Some("the recording stands still: no room"));
        assert_eq!(complaint.look(300, "no room", 90, 0), None, "it was said");
        assert_eq!(complaint.look(400, "", 0, 0), None, "a successor that has written nothing");
        assert_eq!(complaint.look(500, "", 450, 7).as_deref(), Some("the recording goes on, 7 ticks are lost"));
        assert_eq!(complaint.look(600, "", 550, 7), None);
        assert!(complaint.look(700, "no room", 650, 7).is_some());
        assert_eq!(complaint.look(800, "", 750, 0).as_deref(), Some("the recording goes on, nothing is lost"));
    }
}
