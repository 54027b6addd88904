//! Epochs in the roster: who takes a role is killed or stopped at every point of it, and processes contend for it and are killed meanwhile.

use crate::support::*;
use hyst_exchange::{Roster, Tenure};
use hyst_messages::Role;

/// Lives of each contender.
const LIVES: u32 = 60;

/// Whoever dies before he has taken the role has not got it; whoever dies after holds it, and is fenced by the next epoch.
#[test]
fn one_who_is_killed_at_any_point_of_taking_a_role_has_it_or_has_it_not() {
    isolated(one_who_is_killed_at_any_point_of_taking_a_role_has_it_or_has_it_not, |station| {
        let roster = Roster::open(station).unwrap();
        let mut holder = roster.promote(Role::Tissue, Tenure::default(), 1).unwrap();
        for (incarnation, (fate, takes)) in (2u32..).zip([
            ("kill@before-look", false),
            ("abort@before-look", false),
            ("kill@before-claim", false),
            ("abort@before-claim", false),
            ("kill@after-claim", true),
            ("abort@after-claim", true),
        ]) {
            let mut partner = Partner::start(station, "claim", incarnation, fate, 0);
            partner.expect("open");
            partner.tell("look");
            partner.tell("claim");
            partner.await_death();
            let found = roster.holder(Role::Tissue);
            let expected = if takes { Tenure { epoch: holder.epoch + 1, incarnation } } else { holder };
            assert_eq!(found, expected, "{fate}");
            // The next one takes it from whoever the roster names, dead or alive.
            holder = roster.promote(Role::Tissue, found, 1).unwrap();
            assert_eq!(holder.epoch, found.epoch + 1);
        }
    });
}

/// One who slept between look and claim finds the role taken, whatever happened meanwhile, and takes nothing from the new holder.
#[test]
fn one_who_stands_between_look_and_claim_takes_nothing_when_he_goes_on() {
    isolated(one_who_stands_between_look_and_claim_takes_nothing_when_he_goes_on, |station| {
        let roster = Roster::open(station).unwrap();
        let first = roster.promote(Role::Tissue, Tenure::default(), 1).unwrap();
        let mut sleeper = Partner::start(station, "claim", 2, "stop@before-claim", 0);
        sleeper.expect("open");
        sleeper.tell("look");
        sleeper.expect("saw 1");
        sleeper.tell("claim");
        sleeper.await_stop();
        let mut heir = Partner::start(station, "claim", 3, "live", 0);
        heir.expect("open");
        heir.tell("look");
        heir.expect("saw 1");
        heir.tell("claim");
        heir.expect("holds 2");
        // Even if the same incarnation holds it again: the epoch is another.
        let again = roster.promote(Role::Tissue, roster.holder(Role::Tissue), first.incarnation).unwrap();
        sleeper.go_on();
        sleeper.expect("lost to 1");
        assert_eq!(roster.holder(Role::Tissue), again);
    });
}

/// Contenders are killed with SIGKILL wherever they are; each epoch has one holder, and the epochs only grow.
#[test]
fn of_contenders_that_are_killed_all_the_time_one_wins_each_epoch() {
    isolated(of_contenders_that_are_killed_all_the_time_one_wins_each_epoch, |station| {
        let roster = Roster::open(station).unwrap();
        let mut seeded = Seeded(1968);
        let mut last = Tenure::default();
        for life in 0..LIVES {
            let mut contenders: Vec<Partner> = (0..2)
                .map(|index| {
                    let incarnation = 1 + 2 * life + index;
                    drop(station.create_slot(slot(Role::Device), incarnation).unwrap());
                    Partner::start(station, "contend", incarnation, "live", 0)
                })
                .collect();
            contenders.iter_mut().for_each(|contender| contender.expect("contending"));
            let both = last.epoch + 1 + seeded.below(2_000) as u32;
            until(|| (roster.holder(Role::Tissue).epoch >= both).then_some(()));
            contenders.iter_mut().for_each(Partner::kill);
            let found = roster.holder(Role::Tissue);
            // They contend as fast as they can, and not by the ticks of a station.
            assert!(found.epoch >= both && found.is_sound(u64::from(3 + 2 * life), u64::MAX), "{found:?}");
            assert!(found.incarnation > 2 * life, "a holder of before: {found:?}");
            // What each of them noted as its own, the last 64 of each: no epoch twice.
            let won = |index: u32| {
                let page = station.read_slot(slot(Role::Device), 1 + 2 * life + index).unwrap();
                let noted = |epoch: u64| page.ring(hyst_messages::page::device::INPUTS, epoch).is_some();
                (u64::from(last.epoch)..=u64::from(found.epoch)).filter(|epoch| noted(*epoch)).collect::<Vec<_>>()
            };
            let (one, other) = (won(0), won(1));
            assert!(one.iter().all(|epoch| !other.contains(epoch)), "life {life}: an epoch with two holders");
            assert!(!one.is_empty() || !other.is_empty());
            last = found;
        }
    });
}
