//! The time series for research: ten rows a second as CSV. A row holds what was true in the newest tick of its 100, the mean and the largest force of
//! them, and the worst that the last hop applied. A field whose value is not recorded, or no number, is empty.

use crate::force::length;
use crate::motion::finite;
use hyst_messages::{AppliedRecord, FluidStatus, TissueStatus};
use std::fmt::Write;

/// Ticks of a row.
const ROW_TICKS: u64 = 100;

/// The first line.
pub const CSV_HEAD: &str = "tick,time_s,ticks,x_m,y_m,z_m,pitch_rad,yaw_rad,roll_rad,insertion_m,camera_roll_rad,speed_m_s,force_mean_n,force_max_n,worst_kind,\
    buttons,loop_extension_m,inflow_valve,outflow_valve,set_pressure_pa,light,pressure_pa,cavity_volume_ml,deficit_ml,inflow_ml_min,outflow_ml_min,alarms,\
    removed_volume_ml,cuts,bled_ml,focus_m,transmittance,healthy_removed_ml,in_session";

/// A tenth of a second.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// The newest tick's record.
    pub record: AppliedRecord,
    /// That tick, counted from the recording's first.
    pub since_start_ticks: u64,
    /// Whether that tick is one of the session: of a case from when the hand first moves to its end, without a case each.
    pub in_session: bool,
    /// The newest status of the tissue then.
    pub tissue: Option<TissueStatus>,
    /// The newest status of the fluid then, if it is known still.
    pub fluid: Option<FluidStatus>,
    /// Ticks that are there.
    pub ticks: u64,
    /// The worst [`hyst_messages::Applied`] of them.
    pub worst_kind: u32,
    force_sum_n: f64,
    force_ticks: u64,
    force_max_n: f64,
}

impl Row {
    /// The line, without its end.
    pub fn csv(&self) -> String {
        let (sample, pose) = (&self.record.sample, &self.record.sample.pose);
        let controls = &sample.controls;
        let mut line = format!("{},{},{}", self.record.tick, self.since_start_ticks as f64 / 1e3, self.ticks);
        let angles = [pose.pitch_rad, pose.yaw_rad, pose.roll_rad, pose.insertion_m, pose.camera_roll_rad];
        pose.position_m.iter().chain(&angles).for_each(|value| number(&mut line, f64::from(*value), Some(*value)));
        number(&mut line, finite(sample.velocity_m_s).map_or(f64::NAN, length), None);
        let mean_n = if self.force_ticks > 0 { self.force_sum_n / self.force_ticks as f64 } else { f64::NAN };
        number(&mut line, mean_n, None);
        number(&mut line, if self.force_ticks > 0 { self.force_max_n } else { f64::NAN }, None);
        let _ = write!(line, ",{},{}", self.worst_kind, controls.buttons);
        let [inflow, outflow] = [controls.inflow_valve, controls.outflow_valve];
        for value in [controls.loop_extension_m, inflow, outflow, controls.set_pressure_pa, controls.light] {
            number(&mut line, f64::from(value), Some(value));
        }
        match &self.fluid {
            Some(fluid) => {
                number(&mut line, f64::from(fluid.pressure_pa), Some(fluid.pressure_pa));
                number(&mut line, fluid.cavity_volume_ml, None);
                number(&mut line, fluid.deficit_ml, None);
                number(&mut line, f64::from(fluid.inflow_ml_min), Some(fluid.inflow_ml_min));
                number(&mut line, f64::from(fluid.outflow_ml_min), Some(fluid.outflow_ml_min));
                let _ = write!(line, ",{}", fluid.alarms);
            }
            None => line.push_str(",,,,,,"),
        }
        match &self.tissue {
            Some(tissue) => {
                number(&mut line, tissue.removed_volume_ml, None);
                let _ = write!(line, ",{}", tissue.cuts);
            }
            None => line.push_str(",,"),
        }
        number(&mut line, self.fluid.map_or(f64::NAN, |fluid| fluid.bled_ml), None);
        let focus_m = controls.focus_or(f32::NAN); // 0 is none
        number(&mut line, f64::from(focus_m), Some(focus_m));
        let transmittance = self.fluid.and_then(|fluid| fluid.told_transmittance()).unwrap_or(f32::NAN);
        number(&mut line, f64::from(transmittance), Some(transmittance));
        number(&mut line, self.tissue.map_or(f64::NAN, |tissue| tissue.healthy_removed_ml), None);
        let _ = write!(line, ",{}", u8::from(self.in_session));
        line
    }
}

/// A field: the shortest text that gives the same number again, of an f32 as one.
fn number(line: &mut String, value: f64, short: Option<f32>) {
    let _ = match short {
        _ if !value.is_finite() => write!(line, ","),
        Some(short) => write!(line, ",{short}"),
        None => write!(line, ",{value}"),
    };
}

/// The newest statuses of tissue and fluid.
pub(crate) type Statuses = (Option<TissueStatus>, Option<FluidStatus>);

/// The row that is being made.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    open: Row,
}

impl Rows {
    /// Takes a tick, of the session or not, with the newest statuses; gives the row before when it is complete.
    pub(crate) fn tick(
        &mut self,
        record: &AppliedRecord,
        (since_start_ticks, in_session): (u64, bool),
        statuses: Statuses,
    ) -> Option<Row> {
        let is_next = since_start_ticks / ROW_TICKS != self.open.since_start_ticks / ROW_TICKS;
        let done = if is_next { self.finish() } else { None };
        let row = &mut self.open;
        (row.record, row.since_start_ticks, row.in_session) = (*record, since_start_ticks, in_session);
        (row.tissue, row.fluid) = statuses;
        row.ticks += 1;
        row.worst_kind = row.worst_kind.max(record.command.kind);
        if let Some(force_n) = finite(record.command.force_n).map(length) {
            row.force_sum_n += force_n;
            row.force_ticks += 1;
            row.force_max_n = row.force_max_n.max(force_n);
        }
        done
    }

    /// The row that is not complete, if it holds a tick.
    pub(crate) fn finish(&mut self) -> Option<Row> {
        let row = std::mem::take(&mut self.open);
        (row.ticks > 0).then_some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_a_hundred_ticks_with_as_many_fields_as_the_head() {
        let mut rows = Rows::default();
        let mut done = Vec::new();
        for tick in 0..250 {
            let mut record = AppliedRecord { tick: 7 + tick, ..AppliedRecord::default() };
            record.command.force_n = [0.0, tick as f32, 0.0];
            record.command.kind = u32::from(tick == 120);
            record.sample.pose.position_m = [0.1, f32::NAN, 0.0];
            record.sample.controls.focus_m = if tick < 200 { 0.008 } else { 0.0 };
            let healthy_removed_ml = if tick < 200 { 0.125 } else { f64::NAN };
            let tissue = TissueStatus { cuts: 3, removed_volume_ml: 0.25, healthy_removed_ml, ..TissueStatus::default() };
            let told = FluidStatus { transmittance: 0.75, ..FluidStatus::default() };
            done.extend(rows.tick(&record, (tick, tick < 200), (Some(tissue), Some(told).filter(|_| tick < 100))));
        }
        done.extend(rows.finish());
        assert!(rows.finish().is_none());
        let shape: Vec<_> = done.iter().map(|row| (row.record.tick, row.ticks, row.worst_kind)).collect();
        assert_eq!(shape, [(106, 100, 0), (206, 100, 1), (256, 50, 0)]);
        let line = done[1].csv();
        assert!(line.starts_with("206,0.199,100,0.1,,0,0,") && line.ends_with(",,,,,,,0.25,3,,0.008,,0.125,1"), "{line}");
        assert!(line.contains(",149.5,199,1,"), "{line}");
        assert!(done[0].csv().ends_with(",0.25,3,0,0.008,0.75,0.125,1"), "{}", done[0].csv());
        assert!(done[2].csv().ends_with(",0.25,3,,,,,0"), "no focus is stated, and neither view nor wall is recorded");
        for row in &done {
            assert_eq!(row.csv().split(',').count(), CSV_HEAD.split(',').count());
        }
    }
}
