//! What the answers of the collision workers are worth: of which job they are, and for what a worker is distrusted.

use hyst_contact::{Hit, Share};
use hyst_engine::{Life, StepContext};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::header;
use hyst_messages::{Kind, Message};

/// Answers of another step in a row after which a worker is distrusted: one may be late, and then there is one more.
const OFF_IN_A_ROW: u32 = 3;

/// Answers of nothing in a row after which it is: what a job is about may come later than the job, a topology by milliseconds where the cores are full; half a
/// second without it is as good as no worker.
const NOTHING_IN_A_ROW: u32 = 500;

/// Why an answer is not taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Refused {
    /// The worker says that what the job is about has not come to it.
    Nothing,
    /// What it says cannot be of this job.
    Wrong(Distrust),
}

/// Answers of a worker in a row that were not taken.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Row {
    off: u32,
    of_nothing: u32,
}

impl Row {
    /// Counts an answer that is not taken; its worker is distrusted where that was too many.
    pub fn refuse(&mut self, life: &Life, worker: u32, why: Refused, version: u32) {
        let is_late = matches!(why, Refused::Nothing | Refused::Wrong(Distrust::Still));
        life.page.add64(if is_late { header::STALE } else { header::INVALID }, 1);
        let Some(wrong) = self.count(why) else { return };
        life.distrust(worker, wrong);
        if why == Refused::Nothing {
            *self = Row::default();
            let steps = NOTHING_IN_A_ROW;
            life.say(&format!(
                "a worker (incarnation {worker}) has lacked what its jobs are about for {steps} steps (topology {version})"
            ));
        }
    }

    /// One more, and for what the worker is distrusted, if it is.
    fn count(&mut self, why: Refused) -> Option<Distrust> {
        match why {
            Refused::Nothing => {
                *self = Row { off: 0, of_nothing: self.of_nothing.saturating_add(1) };
                (self.of_nothing >= NOTHING_IN_A_ROW).then_some(Distrust::Still)
            }
            Refused::Wrong(why) => {
                self.off = self.off.saturating_add(1);
                (why != Distrust::Still || self.off >= OFF_IN_A_ROW).then_some(why)
            }
        }
    }
}

/// The hits of a worker's answer, if it is the answer to this job by the member that was released; else what is wrong with it.
pub(crate) fn share_of<'a>(
    bytes: &'a [u8],
    context: &StepContext,
    worker: u32,
    share: Share,
    job_hash: u64,
) -> Result<&'a [Hit], Refused> {
    let wrong = Refused::Wrong;
    let message = Message::parse(bytes, Kind::Contacts).map_err(|_| wrong(Distrust::Invalid))?;
    let header = message.header();
    if (header.tick, header.epoch) != (context.tick, context.tenure.epoch) {
        return Err(wrong(Distrust::Still));
    }
    if header.incarnation != worker {
        return Err(wrong(Distrust::Invalid));
    }
    match header.words {
        [index, 0] if index == share.index => return Err(Refused::Nothing),
        words if words != [share.index, share.count] => return Err(wrong(Distrust::Invalid)),
        _ => {}
    }
    if message.section::<u64>(1).ok().and_then(<[u64]>::first) != Some(&job_hash) {
        return Err(wrong(Distrust::Frozen));
    }
    message.section(0).map_err(|_| wrong(Distrust::Invalid))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three in a row of healthy workers were taken for a stamp that stands still while the trainee cut and tissues were killed: the new topology had not come.
    #[test]
    fn a_worker_to_which_what_the_job_is_about_has_not_come_is_given_time() {
        let told = |answers: &[(Refused, u32)]| {
            let mut row = Row::default();
            let all = answers.iter().flat_map(|(why, times)| (0..*times).map(move |_| *why));
            all.map(|why| row.count(why)).position(|told| told.is_some())
        };
        let [late, wrong] = [Distrust::Still, Distrust::Invalid].map(Refused::Wrong);
        assert_eq!(told(&[(Refused::Nothing, NOTHING_IN_A_ROW - 1)]), None);
        assert_eq!(told(&[(Refused::Nothing, NOTHING_IN_A_ROW)]), Some(NOTHING_IN_A_ROW as usize - 1), "it is of no use");
        assert_eq!([told(&[(late, 2)]), told(&[(late, 3)]), told(&[(wrong, 1)])], [None, Some(2), Some(0)]);
        assert_eq!(told(&[(late, 2), (Refused::Nothing, 1), (late, 2)]), None, "it has answered in between");
    }
}
