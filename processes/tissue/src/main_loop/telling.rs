//! What a finished step is said to be: the contact model for the servo, and the status.

use super::MainLoop;
use crate::contacts::LAW;
use crate::state::Core;
use hyst_engine::StepContext;
use hyst_messages::page::tissue;
use hyst_messages::{ContactModel, ContactPlane, Message, TissueStatus};

impl MainLoop<'_> {
    /// Puts the contact model of a finished state into the page.
    pub(super) fn publish_model(&mut self, context: &StepContext, message: &Message<'_>) {
        let mut model = ContactModel {
            epoch: context.tenure.epoch,
            incarnation: self.life.incarnation,
            state_tick: context.next_tick,
            input_tick: message.header().input_tick,
            plane_count: self.planes.count,
            friction: LAW.friction,
            pose_hash: message.record::<Core>(0).map_or(0, |core| core.pose.hash()),
            ..ContactModel::default()
        };
        for (to, from) in model.planes.iter_mut().zip(&self.planes.planes[..self.planes.count as usize]) {
            *to = ContactPlane {
                point_m: from.point_m,
                stiffness_n_m: from.stiffness_n_m,
                normal: from.normal,
                damping_n_s_m: from.damping_n_s_m,
            };
        }
        self.lies.tell(self.life, &mut model);
        self.life.page.write(tissue::MODEL, &model);
    }

    /// Notes what a step was, for the status.
    pub(super) fn account(&mut self, core: &Core, cavity_pressure_pa: f32, substeps: u32, times_ns: [u64; 5]) {
        let figures = (self.collision.missing(), self.collision.dropped(), substeps);
        let hold_m = self.world.case.tool.jaws().map_or(0.0, |_| core.hold_m);
        self.status = TissueStatus { hold_m, ..status_of(self.status, core, cavity_pressure_pa, figures, times_ns) };
    }
}

/// The status of a step after the one before, with shares that were missing, hits that were dropped and substeps; `times_ns`: when it began, and when
/// test, response, deformation and all had ended.
fn status_of(
    before: TissueStatus,
    core: &Core,
    cavity_pressure_pa: f32,
    (shares_missing, hits_dropped, substeps): (u32, u32, u32),
    times_ns: [u64; 5],
) -> TissueStatus {
    let us = |part: usize| (times_ns[part + 1] - times_ns[part]) as f32 * 1e-3;
    TissueStatus {
        removed_volume_ml: core.removed_volume_ml,
        largest_piece_ml: core.largest_piece_ml,
        healthy_removed_ml: core.healthy_removed_ml,
        cuts: core.cuts,
        is_cutting: core.is_cutting,
        washed_out: core.washed_out,
        washed_out_ml: core.washed_out_ml as f32,
        held: core.held,
        taken_out: core.taken_out,
        taken_out_ml: core.taken_out_ml as f32,
        cut_limits: core.cut_limits,
        substeps,
        corrections: core.corrections,
        hits_dropped,
        cavity_pressure_pa,
        contact_count: core.contact_count,
        tool_force_n: core.force_n,
        shares_missing,
        phase_us: [us(2), us(0), us(1), us(3)],
        ..before
    }
}
