//! How often an engine is swapped into its private station: until a swap says something of it. On a busy machine one is undone for a reason that is not the
//! engine's, and one is refused while the old engine is on its way back. Promise: neither is held against the engine, and the tries have an end.

use super::{Private, WHOLE_WITHIN_NS, wait_until};
use crate::commands::swap::{NotBegun, begin_unless, wait};
use crate::policy::Cause;
use crate::settings::Refusal;
use crate::swap::Record;
use hyst_exchange::system;
use hyst_messages::Role;
use std::path::Path;

/// Swaps that may end and say nothing of it.
const TRIES: u32 = 3;
/// How long a swap is asked for that the station refuses, and the time between two tries, ns: for each the engine is copied, and asked what it is.
const BEGUN_WITHIN_NS: u64 = 30_000_000_000;
const AGAIN_NS: u64 = 500_000_000;

/// What follows from a try.
#[derive(Debug, PartialEq)]
enum Next {
    /// It says something of the engine.
    Told(Record),
    /// It says nothing of it, and the next one may.
    Again,
    /// It says nothing of it, for this reason, and no more are made.
    Untold(String),
}

/// The tries so far.
#[derive(Debug, Default)]
struct Tries {
    /// Swaps that have ended and said nothing of the engine.
    untold: u32,
    /// Since when each that was asked for was refused, ns.
    refused_ns: Option<u64>,
}

impl Tries {
    /// A swap has ended.
    fn ended(&mut self, record: Record) -> Next {
        self.refused_ns = None;
        if record.cause.is_none_or(Cause::speaks_of_newcomer) {
            return Next::Told(record);
        }
        self.untold += 1;
        if self.untold < TRIES { Next::Again } else { Next::Untold(record.reason) }
    }

    /// The station has not begun one. The engine has said before that it is one of its role: so it is the station that is not as it should be.
    fn refused(&mut self, why: String, now_ns: u64) -> Next {
        let since_ns = *self.refused_ns.get_or_insert(now_ns);
        if now_ns.saturating_sub(since_ns) < BEGUN_WITHIN_NS { Next::Again } else { Next::Untold(why) }
    }
}

/// Swaps an engine in until that says something of it: what was written down of that swap, or why none did.
pub(super) fn swapped(role: Role, binary: &Path, private: &mut Private) -> Result<Result<Record, String>, Refusal> {
    let mut tries = Tries::default();
    loop {
        // Whoever was replaced for the try before is started again only now.
        wait_until(private, role, WHOLE_WITHIN_NS, |_| true)?;
        let next = match begin_unless(&private.station, role.name(), binary, private.interrupted) {
            Ok(number) => tries.ended(wait(&private.station, number, private.interrupted)?),
            Err(NotBegun::Refused(refusal)) => tries.refused(refusal.message, system::now_ns()),
            Err(NotBegun::Unasked(refusal)) => return Err(refusal),
        };
        match next {
            Next::Told(record) => return Ok(Ok(record)),
            Next::Untold(why) => return Ok(Err(why)),
            Next::Again => system::sleep_ns(AGAIN_NS),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::swap::tests::record;

    fn ended(promoted: bool, cause: Option<Cause>) -> Record {
        Record { promoted: Some(promoted), cause, reason: "why".into(), ..record() }
    }

    /// One whose private supervisor had died did not conform.
    #[test]
    fn a_swap_that_says_nothing_of_the_engine_is_made_again_and_any_other_is_told() {
        for causes in [[Cause::NoTime; 3], [Cause::Interrupted; 3], [Cause::NoTime, Cause::Interrupted, Cause::NoTime]] {
            let mut tries = Tries::default();
            let nexts = causes.map(|cause| tries.ended(ended(false, Some(cause))));
            assert_eq!(nexts, [Next::Again, Next::Again, Next::Untold("why".into())]);
        }
        let own = [Cause::NotReady, Cause::Died, Cause::OutOfTolerance, Cause::Missed, Cause::NotCompared].map(Some);
        for told in own.map(|cause| ended(false, cause)).into_iter().chain([ended(true, None)]) {
            let mut tries = Tries { untold: TRIES - 1, refused_ns: None };
            assert_eq!(tries.ended(told.clone()), Next::Told(told));
        }
    }

    /// The second try of an engine that is swapped in its place ended with the words that it was no engine of that role.
    #[test]
    fn a_swap_that_the_station_refuses_is_asked_for_again_for_a_while_and_then_nothing_is_known() {
        let refused = |tries: &mut Tries, now_ns: u64| tries.refused("rendering is not ready now".into(), now_ns);
        let mut tries = Tries::default();
        assert_eq!([7, 6 + BEGUN_WITHIN_NS].map(|now_ns| refused(&mut tries, now_ns)), [Next::Again, Next::Again]);
        assert_eq!(refused(&mut tries, 7 + BEGUN_WITHIN_NS), Next::Untold("rendering is not ready now".into()));
        assert_eq!(tries.ended(ended(false, Some(Cause::NoTime))), Next::Again);
        assert_eq!(refused(&mut tries, 8 + BEGUN_WITHIN_NS), Next::Again, "after one that was begun it is the first again");
    }
}
