//! What is about the chain of states: who reads it, deaths, the supervisor's word about them, a successor, time.

use super::*;

impl Chain {
    pub(super) fn consume(&self, world: &World, stream: usize) -> Option<Step> {
        let found = world.processes[stream].stream?;
        let newest = world.consumer;
        let takes = match self.flaw {
            Flaw::Anything => newest != Some(found),
            _ => self.take(newest, found),
        };
        if !takes {
            return None;
        }
        if let Some(newest) = newest
            && (found.key.0 < newest.key.0 || found.key.1 < newest.key.1)
        {
            return Some(Err(format!("the consumer takes {:?} after {:?}", found.key, newest.key)));
        }
        Some(Ok(World { consumer: Some(found), seen: Sights::default(), ..world.clone() }))
    }

    /// Deaths, the supervisor's word about them, a successor, time.
    pub(super) fn world(&self, world: &World, out: &mut Vec<(&'static str, Step)>) {
        // Beyond the end, for who has to see a death first: its last state may be a tick ahead.
        let last = self.ticks + if world.is_orphaned() { 2 * world.deaths } else { 0 };
        if world.clock < last {
            out.push(("a tick passes", Ok(World { clock: world.clock + 1, seen: Sights::default(), ..world.clone() })));
        }
        for me in 0..PROCESSES {
            let process = &world.processes[me];
            let mut next = World { seen: Sights::default(), ..world.clone() };
            let follows = process.newest.is_some() && !matches!(process.at, At::Dead | At::Unborn) && world.roster.1 != me as u8;
            if follows && world.handed < self.handed {
                let roster = (world.roster.0 + 1, me as u8);
                out.push(("the supervisor hands over", Ok(World { roster, handed: world.handed + 1, ..next.clone() })));
            }
            match process.at {
                At::Unborn if world.processes.iter().any(|other| other.known_dead) => {
                    let is_closed = |index: usize| u8::from(world.processes[index].known_dead) << index;
                    next.processes[me].closed = (0..PROCESSES).map(is_closed).sum();
                    next.processes[me].at = At::Idle;
                    next.seen.0 |= SUCCESSOR;
                    out.push(("a successor is born", Ok(next)));
                }
                At::Unborn => {}
                At::Dead if process.known_dead => {}
                At::Dead => {
                    next.processes[me].known_dead = true;
                    out.push(("a death is known", Ok(next)));
                }
                _ if world.deaths < self.deaths => {
                    next.deaths += 1;
                    next.processes[me].at = At::Dead;
                    out.push((["0 dies", "1 dies", "2 dies"][me], Ok(next)));
                }
                _ => {}
            }
        }
    }
}
