//! A scalar field in bands of layers, each band behind its own lock.
//!
//! Promise: phases take read locks on what they read and a write lock on their own band of what they write; in the protocol of
//! [`crate::Phase`] no lock is ever contended, and a breach of the protocol ends in [`FlowError::PhaseConflict`], never in a wait.

use std::sync::Arc;

use parking_lot::{RwLock, RwLockReadGuard, RwLockWriteGuard};

use crate::error::FlowError;
use crate::grid::{Layout, MAX_BANDS};

pub(crate) struct Field {
    layout: Arc<Layout>,
    bands: Vec<RwLock<Vec<f32>>>,
}

impl Field {
    pub fn new(layout: &Arc<Layout>) -> Self {
        let bands = (0..layout.bands).map(|b| RwLock::new(vec![0.0; layout.stored(b).len() * layout.plane])).collect();
        Self { layout: layout.clone(), bands }
    }
    pub fn read(&self) -> Result<Read<'_>, FlowError> {
        let mut guards = [const { None }; MAX_BANDS];
        for (guard, band) in guards.iter_mut().zip(&self.bands) {
            *guard = Some(band.try_read().ok_or(FlowError::PhaseConflict)?);
        }
        Ok(Read { layout: &self.layout, guards })
    }
    pub fn write(&self, band: usize) -> Result<Write<'_>, FlowError> {
        let guard = self.bands[band].try_write().ok_or(FlowError::PhaseConflict)?;
        Ok(Write { layout: &self.layout, band, guard })
    }
}

/// All layers of a field, to read.
pub(crate) struct Read<'a> {
    layout: &'a Layout,
    guards: [Option<RwLockReadGuard<'a, Vec<f32>>>; MAX_BANDS],
}

impl Read<'_> {
    /// Plane of padded layer `kk`.
    pub fn layer(&self, kk: usize) -> &[f32] {
        let band = self.layout.band_of(kk);
        let at = (kk - self.layout.stored(band).start) * self.layout.plane;
        match &self.guards[band] {
            Some(guard) => &guard[at..at + self.layout.plane],
            None => &[],
        }
    }
    /// The planes below, at and above padded layer `kk`.
    pub fn three(&self, kk: usize) -> [&[f32]; 3] {
        [self.layer(kk - 1), self.layer(kk), self.layer(kk + 1)]
    }
}

/// The layers of one band of a field, to write.
pub(crate) struct Write<'a> {
    layout: &'a Layout,
    band: usize,
    guard: RwLockWriteGuard<'a, Vec<f32>>,
}

impl Write<'_> {
    /// Plane of padded layer `kk`, which must be stored with this band.
    pub fn layer(&mut self, kk: usize) -> &mut [f32] {
        let at = (kk - self.layout.stored(self.band).start) * self.layout.plane;
        &mut self.guard[at..at + self.layout.plane]
    }
    /// Padded layer `from` (to read) and `to` (to write), both of this band.
    pub fn pair(&mut self, from: usize, to: usize) -> (&[f32], &mut [f32]) {
        let plane = self.layout.plane;
        let start = self.layout.stored(self.band).start;
        let (from, to) = ((from - start) * plane, (to - start) * plane);
        if from < to {
            let (low, high) = self.guard.split_at_mut(to);
            (&low[from..from + plane], &mut high[..plane])
        } else {
            let (low, high) = self.guard.split_at_mut(from);
            (&high[..plane], &mut low[to..to + plane])
        }
    }
}
