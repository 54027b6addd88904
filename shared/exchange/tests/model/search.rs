//! Breadth-first search over all states of a model.

use std::collections::HashMap;
use std::fmt::Debug;
use std::hash::{BuildHasherDefault, Hash, Hasher};

/// A model: its first state, its steps, what must hold.
pub trait Model {
    /// All that the next step depends on, and what is remembered for the properties.
    type State: Clone + Hash + Debug;
    /// The first state.
    fn first(&self) -> Self::State;
    /// Every state that one step of one process, or of the world, leads to, with the step's name; a broken promise is an error.
    fn steps(&self, state: &Self::State, out: &mut Vec<(&'static str, Result<Self::State, String>)>);
    /// What must hold in each state.
    fn holds(&self, state: &Self::State, steps: &[&'static str]) -> Result<(), String>;
    /// Whether nothing more is to come.
    fn is_end(&self, state: &Self::State) -> bool;
    /// What of interest the step that led to this state has shown, one bit each: a search that never saw it proves nothing about it.
    fn sights(&self, state: &Self::State) -> u64;
}

/// What a step has shown; no part of the state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sights(pub u64);

impl Hash for Sights {
    fn hash<H: Hasher>(&self, _: &mut H) {}
}

/// What a search that found nothing wrong has seen.
#[derive(Clone, Copy, Debug)]
pub struct Searched {
    /// States.
    pub states: usize,
    /// States at the end.
    pub ends: usize,
    /// All sights.
    pub sights: u64,
}

/// Most states of one search: beyond it a model is too large for a test.
const MOST_STATES: usize = 12_000_000;

/// Two independent lanes of multiply and rotate. 128 bits stand for a state: for ten million states the chance that any two share them is
/// below 10⁻²⁴.
struct Mark(u64, u64);

impl Hasher for Mark {
    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_ne_bytes(word));
        }
    }
    fn write_u8(&mut self, value: u8) {
        self.write_u64(value as u64);
    }
    fn write_u64(&mut self, value: u64) {
        self.0 = (self.0 ^ value).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29);
        self.1 = (self.1.wrapping_add(value ^ 0xA5A5)).wrapping_mul(0xD6E8_FEB8_6659_FD93).rotate_left(37);
    }
    fn finish(&self) -> u64 {
        let mixed = (self.0 ^ self.0 >> 32).wrapping_mul(0xD6E8_FEB8_6659_FD93);
        mixed ^ mixed >> 32
    }
}

fn mark_of(state: &impl Hash) -> u128 {
    let mut mark = Mark(1, 2);
    state.hash(&mut mark);
    let second = (mark.1 ^ mark.1 >> 32).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mark.finish() as u128) << 64 | (second ^ second >> 32) as u128
}

/// A mark is its own hash.
#[derive(Default)]
struct Marked(u64);

impl Hasher for Marked {
    fn write(&mut self, _: &[u8]) {}
    fn write_u128(&mut self, value: u128) {
        self.0 = value as u64;
    }
    fn finish(&self) -> u64 {
        self.0
    }
}

/// Searches all states; the error is what broke, with a shortest way there.
pub fn search<M: Model>(model: &M) -> Result<Searched, String> {
    let first = model.first();
    let mut index: HashMap<u128, u32, BuildHasherDefault<Marked>> = HashMap::default();
    index.insert(mark_of(&first), 0);
    // For each state: from which it was first reached, by which step.
    let mut reached: Vec<(u32, &'static str)> = vec![(0, "")];
    let mut edges: Vec<(u32, u32)> = Vec::new();
    let mut ends: Vec<u32> = Vec::new();
    let (mut sights, mut steps) = (0, Vec::new());
    let mut layer = vec![(0u32, first)];
    while !layer.is_empty() {
        let mut next_layer = Vec::new();
        for (at, state) in layer {
            steps.clear();
            model.steps(&state, &mut steps);
            let names: Vec<&'static str> = steps.iter().map(|(name, _)| *name).collect();
            model.holds(&state, &names).map_err(|broken| way(&reached, at, &format!("{broken}\n{state:#?}")))?;
            if model.is_end(&state) {
                ends.push(at);
            }
            for (name, next) in steps.drain(..) {
                let next = next.map_err(|broken| way(&reached, at, &format!("{name}: {broken}\n{state:#?}")))?;
                sights |= model.sights(&next);
                let new = reached.len() as u32;
                let to = *index.entry(mark_of(&next)).or_insert(new);
                edges.push((to, at));
                if to == new {
                    reached.push((at, name));
                    next_layer.push((to, next));
                }
            }
        }
        assert!(reached.len() <= MOST_STATES, "more than {MOST_STATES} states");
        layer = next_layer;
    }
    if let Some(stuck) = without_end(reached.len(), edges, &ends) {
        return Err(way(&reached, stuck, "from here no way leads to an end"));
    }
    Ok(Searched { states: reached.len(), ends: ends.len(), sights })
}

/// A state from which no end can be reached, if there is one.
fn without_end(states: usize, mut edges: Vec<(u32, u32)>, ends: &[u32]) -> Option<u32> {
    edges.sort_unstable();
    let mut leads_to_end = vec![false; states];
    let mut open = ends.to_vec();
    ends.iter().for_each(|end| leads_to_end[*end as usize] = true);
    while let Some(to) = open.pop() {
        let from = edges.partition_point(|edge| edge.0 < to);
        for &(_, before) in edges[from..].iter().take_while(|edge| edge.0 == to) {
            if !std::mem::replace(&mut leads_to_end[before as usize], true) {
                open.push(before);
            }
        }
    }
    leads_to_end.iter().position(|leads| !leads).map(|at| at as u32)
}

/// The steps from the first state to `at`.
fn way(reached: &[(u32, &'static str)], mut at: u32, end: &str) -> String {
    let mut names = Vec::new();
    while at != 0 {
        let (before, name) = reached[at as usize];
        names.push(name);
        at = before;
    }
    names.reverse();
    format!("{end}\nafter: {}", names.join("; "))
}
