//! How the objects look, asked for by rendezvous on request: when a topology is new, and again if the answer is of another one. Rendering never waits for
//! it; until it comes, and if it never comes, the usual looks of the objects' kinds are drawn.

use crate::sources::REPLICAS;
use hyst_exchange::rendezvous::{Client, ProcessClient};
use hyst_messages::stream::{AppearanceRecord, ScopeRecord};
use rendering::{Appearance, Material};

/// How long one tissue is waited for before the other is asked, ns.
const PATIENCE_NS: u64 = 500_000_000;
/// Answers of another topology that are asked again: one a picture, for a second of the fastest ones. A tissue that follows has made the world of a cut by
/// then, and who never names the topology that is shown is left alone until the next one.
const MOST_OTHERS: usize = 250;
/// Most objects in an answer.
const MAX_RECORDS: usize = rendering::MAX_OBJECTS;

/// An answer that makes no sense, and the incarnation that gave it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Senseless(pub u32);

/// An answer: how the scope sees, and how each object looks.
pub type Answer = (ScopeRecord, Vec<AppearanceRecord>);

/// The asking side.
#[derive(Debug, Default)]
pub struct Looks {
    clients: [Option<(u32, ProcessClient)>; REPLICAS],
    wanted: bool,
    /// Answers since then that made no sense: each tissue is believed to be able to give another one, and asked no more than that.
    senseless: usize,
    /// Answers since then that were of another topology.
    others: usize,
    asked: Option<usize>,
    last: usize,
    until_ns: u64,
}

/// The records of an answer, the scope's and the objects'; `None` for one that makes no sense.
fn records(answer: &[u8]) -> Option<Answer> {
    let (head, objects) = answer.split_at_checked(size_of::<ScopeRecord>())?;
    let size = size_of::<AppearanceRecord>();
    let scope: ScopeRecord = bytemuck::pod_read_unaligned(head);
    let is_whole = objects.len().is_multiple_of(size) && objects.len() / size <= MAX_RECORDS && is_sound(&scope);
    let read = || objects.chunks_exact(size).map(bytemuck::pod_read_unaligned).collect::<Vec<AppearanceRecord>>();
    Some((scope, is_whole.then(read)?)).filter(|(_, objects)| objects.iter().all(can_be_drawn))
}

/// Whether colour and roughness are shares.
fn can_be_drawn(record: &AppearanceRecord) -> bool {
    record.colour.iter().chain([&record.roughness]).all(|share| (0.0..=1.0).contains(share))
}

/// Whether a scope can be drawn and looked through.
fn is_sound(scope: &ScopeRecord) -> bool {
    let within = |value: f32, low: f32, high: f32| (low..=high).contains(&value);
    within(scope.oblique_rad, 0.0, 1.6)
        && within(scope.field_of_view_rad, 0.3, 2.7)
        && within(scope.periphery_ratio, 0.1, 1.0)
        && within(scope.light, 0.0, 10.0)
        && within(scope.shaft_radius_m, 1e-4, 0.02)
        && within(scope.shaft_length_m, 1e-3, 1.0)
        && within(scope.loop_radius_m, 0.0, 0.02)
        && within(scope.loop_wire_radius_m, 0.0, 0.001)
}

/// A record as the stage takes it.
pub fn appearance(record: &AppearanceRecord) -> Appearance {
    let material = match record.material {
        0 => Material::MucosaTissue,
        1 => Material::Polyp,
        2 => Material::Myoma,
        3 => Material::Metal,
        _ => Material::MucosaTissue,
    };
    Appearance { base_colour: record.colour, roughness: record.roughness, ..Appearance::of(material) }
}

impl Looks {
    /// The looks are needed, again.
    pub fn want(&mut self) {
        (self.wanted, self.asked, self.senseless, self.others) = (true, None, 0, 0);
    }

    /// The answer was of objects of another topology than is shown: that of a tissue which has not made the world of the last cut yet, or has made that of the
    /// next one already. The next tissue is asked.
    pub fn want_others(&mut self) {
        self.others += 1;
        self.wanted |= self.others <= MOST_OTHERS;
    }

    /// A tissue, or its successor.
    pub fn replace(&mut self, index: usize, incarnation: u32, client: ProcessClient) {
        self.clients[index] = Some((incarnation, client));
        if self.asked == Some(index) {
            self.asked = None;
        }
    }

    /// The answer, once; asks if it is time to. After one that makes no sense another tissue is asked.
    pub fn poll(&mut self, now_ns: u64) -> Option<Result<Answer, Senseless>> {
        if !self.wanted {
            return None;
        }
        if let Some(index) = self.asked {
            let answer = self.clients[index].as_mut().map(|(tissue, client)| (*tissue, client.poll()));
            match answer {
                Some((tissue, Ok(Some(bytes)))) => return Some(self.take(records(&bytes), tissue)),
                Some((_, Ok(None))) if now_ns < self.until_ns => return None,
                _ => self.asked = None, // gone, silent or broken: the next one is asked
            }
        }
        for _ in 0..REPLICAS {
            self.last = (self.last + 1) % REPLICAS;
            if let Some((_, client)) = &mut self.clients[self.last]
                && client.begin(b"objects ").is_ok()
            {
                (self.asked, self.until_ns) = (Some(self.last), now_ns + PATIENCE_NS);
                break;
            }
        }
        None
    }

    fn take(&mut self, answer: Option<Answer>, tissue: u32) -> Result<Answer, Senseless> {
        self.senseless += usize::from(answer.is_none());
        (self.wanted, self.asked) = (answer.is_none() && self.senseless < REPLICAS, None);
        answer.ok_or(Senseless(tissue))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_that_is_none_makes_an_answer_senseless_and_others_are_asked_as_often_as_there_are_some() {
        let scope = ScopeRecord {
            field_of_view_rad: 1.6,
            periphery_ratio: 0.5,
            shaft_radius_m: 0.0025,
            shaft_length_m: 0.3,
            ..ScopeRecord::default()
        };
        let answer = |colour: [f32; 3], roughness: f32| {
            let object = AppearanceRecord { colour, roughness, ..AppearanceRecord::default() };
            records(&[bytemuck::bytes_of(&scope), bytemuck::bytes_of(&object)].concat())
        };
        let good = answer([0.0, 0.5, 1.0], 0.3);
        assert!(good.is_some());
        for (colour, roughness) in [([0.1, f32::NAN, 0.1], 0.3), ([0.1; 3], f32::INFINITY), ([1e9, 0.1, 0.1], 0.3)] {
            assert_eq!(answer(colour, roughness), None, "{colour:?} {roughness}");
        }
        let mut looks = Looks::default();
        looks.want();
        for senseless in 1..=REPLICAS {
            assert_eq!(looks.take(None, 7), Err(Senseless(7)));
            assert_eq!(looks.wanted, senseless < REPLICAS);
        }
        looks.want();
        assert_eq!((looks.take(good.clone(), 8).ok(), looks.wanted), (good, false));
    }

    #[test]
    fn answers_of_another_topology_are_asked_again_for_a_time() {
        let answer = Some((ScopeRecord::default(), Vec::new()));
        let mut looks = Looks::default();
        looks.want();
        assert_eq!(looks.take(None, 7), Err(Senseless(7)), "one of the tissues lies");
        for other in 1..=MOST_OTHERS + 1 {
            assert!(looks.take(answer.clone(), 8).is_ok() && !looks.wanted);
            looks.want_others();
            assert_eq!((looks.wanted, looks.senseless), (other <= MOST_OTHERS, 1), "{other}");
        }
        looks.want();
        assert_eq!((looks.wanted, looks.others), (true, 0), "another topology is shown");
    }

    #[test]
    fn an_answer_of_another_length_is_no_answer() {
        let record = AppearanceRecord { id: 4, material: 3, colour: [0.1, 0.2, 0.3], roughness: 0.4, ..Default::default() };
        let scope = ScopeRecord {
            oblique_rad: 0.5,
            field_of_view_rad: 1.6,
            periphery_ratio: 0.5,
            light: 1.0,
            shaft_radius_m: 0.0025,
            shaft_length_m: 0.3,
            loop_radius_m: 0.0022,
            loop_wire_radius_m: 0.000_15,
        };
        let head = bytemuck::bytes_of(&scope);
        let bytes = [head, bytemuck::cast_slice(&[record, record])].concat();
        assert_eq!(records(&bytes), Some((scope, vec![record, record])));
        assert_eq!(records(&bytes[..bytes.len() - 1]), None);
        assert_eq!(records(&[head, &vec![0; size_of::<AppearanceRecord>() * (MAX_RECORDS + 1)]].concat()), None);
        assert_eq!(records(head), Some((scope, Vec::new())));
        assert_eq!(records(&[]), None);
        let blind = ScopeRecord { field_of_view_rad: f32::NAN, ..scope };
        let huge = ScopeRecord { loop_radius_m: 1.0, ..scope };
        assert_eq!([blind, huge].map(|scope| records(bytemuck::bytes_of(&scope))), [None, None]);
    }

    #[test]
    fn an_unknown_material_is_drawn_as_tissue() {
        let of = |material| appearance(&AppearanceRecord { material, ..Default::default() }).material;
        assert_eq!([1, 2, 3, 77].map(of), [Material::Polyp, Material::Myoma, Material::Metal, Material::MucosaTissue]);
    }
}
