//! What the answers of the collision workers are worth: of which job they are, and for what a worker is distrusted.

use hyst_contact::{Hit, Share};
use hyst_engine::{Life, StepContext};
use hyst_messages::page::device::Distrust;
use hyst_messages::page::header;
use hyst_messages::{Kind, Message, TOO_MANY_HITS};

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
    /// The worker says that there are more hits than there is room for, which is nobody's fault.
    TooMany,
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
        match why {
            Refused::TooMany => {}
            Refused::Nothing | Refused::Wrong(Distrust::Still) => life.page.add64(header::STALE, 1),
            Refused::Wrong(_) => life.page.add64(header::INVALID, 1),
        }
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
            Refused::TooMany => {
                *self = Row::default();
                None
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
        [index, TOO_MANY_HITS] if index == share.index => return Err(Refused::TooMany),
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
    use hyst_contact::Split;
    use hyst_exchange::roster::Tenure;
    use hyst_messages::stream::message_bytes;
    use hyst_messages::{MessageMut, StreamHeader};

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
        // However often there are more hits than there is room for: that is the tissue's, which lies in itself.
        let few = (Refused::Nothing, NOTHING_IN_A_ROW - 1);
        assert_eq!(told(&[(Refused::TooMany, 3 * NOTHING_IN_A_ROW), few, (Refused::TooMany, 1), few]), None);
    }

    #[test]
    fn an_answer_of_nothing_or_of_too_many_hits_is_known_by_its_count_and_another_count_is_wrong() {
        let context = StepContext {
            tick: 7,
            next_tick: 8,
            state_epoch: 1,
            state_writer: 1,
            step_ticks: 1,
            tenure: Tenure { epoch: 2, incarnation: 1 },
            holding: true,
            deadline_ns: 0,
        };
        let share = Share { index: 1, count: 2, split: Split::Tets };
        let why = |words: [u32; 2]| {
            let sections = [0, 8];
            let mut memory = vec![0u64; message_bytes(&sections).div_ceil(8)];
            let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut memory);
            let header = StreamHeader { tick: 7, epoch: 2, incarnation: 9, words, ..StreamHeader::default() };
            let mut message = MessageMut::format(bytes, Kind::Contacts, header, &sections).unwrap();
            message.section::<u64>(1).unwrap().fill(5);
            share_of(bytemuck::cast_slice(&memory), &context, 9, share, 5).map(<[Hit]>::len)
        };
        let wrong = Err(Refused::Wrong(Distrust::Invalid));
        assert_eq!([why([1, 2]), why([1, 0]), why([1, TOO_MANY_HITS])], [Ok(0), Err(Refused::Nothing), Err(Refused::TooMany)]);
        assert_eq!([why([0, TOO_MANY_HITS]), why([1, 3]), why([0, 0])], [wrong; 3]);
    }
}
