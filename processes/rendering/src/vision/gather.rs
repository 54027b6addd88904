//! What a picture takes from the others: surfaces, medium, bubbles and flakes, looks, and in the view from outside where the hand feels something.

use super::{Vision, lens_m};
use crate::looks::Senseless;
use crate::medium;
use crate::scenery::Refused;
use crate::sources::Sources;
use hyst_exchange::system;
use hyst_messages::controls::WINDOW_PRESSURE;
use hyst_messages::page::device::Distrust;
use hyst_messages::page::header;
use hyst_messages::{HardwareSample, InputRecord, Pose, StreamHeader};
use rendering::{Arrow, RenderError};

/// Length of an arrow for each newton, m: the 3.3 N of a desktop device are as long as a cavity.
const FORCE_M_PER_N: f32 = 0.012;
/// Length of the arrow of a plane of the contact model that the tip lies behind, and of one that it does not touch, m.
const PLANE_M: [f32; 2] = [0.004, 0.0015];
/// No plane is shown farther from the tip, m.
const FARTHEST_PLANE_M: f32 = 0.005;

/// What is said where lines of meshes are wanted and the device draws none.
const NO_LINES: &str = "this device draws no lines of meshes";

fn without_lines(are_wanted: bool, are_drawn: bool) -> Option<String> {
    (are_wanted && !are_drawn).then(|| NO_LINES.to_string())
}

/// The planes of the contact model as arrows along their normals, and the force on the hand as one from the tip.
fn arrows(input: &InputRecord) -> (Vec<Arrow>, Arrow) {
    let Pose { position_m, .. } = input.sample.pose;
    let depth_m = |point_m: [f32; 3], normal: [f32; 3]| (0..3).map(|a| (point_m[a] - position_m[a]) * normal[a]).sum::<f32>();
    let count = (input.model.plane_count as usize).min(input.model.planes.len());
    let planes = input.model.planes[..count].iter().map(|plane| {
        // A wall that the shaft is at is as far from the tip as it lets the tip move.
        let depth_m = depth_m(plane.point_m, plane.normal);
        let shown_m = depth_m.clamp(-FARTHEST_PLANE_M, FARTHEST_PLANE_M);
        let length_m = PLANE_M[usize::from(depth_m <= 0.0)];
        let from_m = std::array::from_fn(|axis| position_m[axis] + plane.normal[axis] * shown_m);
        Arrow { from_m, along_m: plane.normal.map(|part| part * length_m) }
    });
    let force = Arrow { from_m: position_m, along_m: input.applied_n.map(|part| part * FORCE_M_PER_N) };
    (planes.collect(), force)
}

/// What the stage refuses of a stream is left out, `None`, and ends nothing, for the successor would be told the same; a device that is lost ends all.
fn spared<T>(done: Result<T, RenderError>) -> Result<Option<T>, RenderError> {
    match done {
        Ok(value) => Ok(Some(value)),
        Err(error @ RenderError::DeviceLost(_)) => Err(error),
        Err(_) => Ok(None),
    }
}

/// What has come of a state.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Taken {
    Shown,
    /// It can be shown once something has come that is under way.
    Waits,
    /// It makes no sense.
    LeftOut,
}

/// Shows the newer of the state that has come and the one that waits, or else the other one. What cannot be shown yet waits until the next picture: while the
/// wire cuts, the topology of the newest state is often a few ms behind it, and is there by then.
fn take_newest<T>(
    newest: Option<T>,
    waiting: &mut Option<T>,
    mut show: impl FnMut(&T) -> Result<Taken, RenderError>,
) -> Result<(), RenderError> {
    for state in [newest, waiting.take()].into_iter().flatten() {
        match show(&state)? {
            Taken::Shown => return Ok(()),
            Taken::Waits if waiting.is_none() => *waiting = Some(state),
            Taken::Waits | Taken::LeftOut => {}
        }
    }
    Ok(())
}

impl Vision<'_> {
    /// Writes over the picture: the strip, the keys of a window, the case, what the hand feels, what cannot be drawn.
    pub(super) fn write(&mut self, sources: &Sources, tick: u64, sample: Option<&HardwareSample>, has_window: bool) {
        let felt = self.mark(sources);
        let given = sample.map_or(0, |sample| sample.from_window);
        let set_pa = sample.filter(|_| given & WINDOW_PRESSURE != 0).map(|sample| sample.controls.obeyed_pressure_pa());
        self.strip.look(&self.life.clock, tick);
        self.strip.hear(self.life, tick);
        self.strip.heed(sources.cut_limits(), tick);
        self.strip.turn(sample.map(|sample| &sample.controls));
        let fluid = self.strip.smooth(sources.pump());
        let mut overlay = self.strip.overlay(tick, fluid.as_ref(), set_pa);
        if has_window {
            let focus_m = sample.map_or(self.usual_focus_m, |sample| sample.controls.focus_or(self.usual_focus_m));
            overlay.lines.extend(self.switches.lines(given, focus_m));
        }
        overlay.lines.extend(self.strip.case());
        overlay.lines.extend(felt);
        overlay.lines.extend(without_lines(self.switches.has_lines(), self.renderer.gpu().draws_lines()));
        self.view.overlay = overlay;
    }

    /// Marks in the view from outside where the hand feels something, and what; gives the line that says so.
    fn mark(&mut self, sources: &Sources) -> Option<String> {
        let felt = self.switches.external.then(|| sources.felt()).flatten();
        let Some((planes, force)) = felt.as_ref().map(arrows) else {
            self.marks.clear(self.renderer.stage());
            return None;
        };
        if self.marks.show(self.renderer.stage(), &planes, force).is_err() {
            self.life.page.add64(header::INVALID, 1); // a full stage costs the arrows
        }
        let force_n = force.along_m.iter().map(|part| part * part).sum::<f32>().sqrt() / FORCE_M_PER_N;
        Some(format!("force {force_n:.2} N, {} planes near the tip", planes.len()))
    }

    /// Takes what is new: topology, state, looks. What makes no sense is left out, counted, and said once.
    pub(super) fn gather(&mut self, sources: &mut Sources) -> Result<(), RenderError> {
        (self.uploaded, self.copied) = (0, 0);
        let newest = sources.state().filter(|(state, _)| Some((state.epoch, state.tick)) > self.shown);
        let mut waiting = self.waiting.take();
        let taken = take_newest(newest, &mut waiting, |(state, held)| self.show_state(sources, state, held.bytes()));
        self.waiting = waiting;
        taken?;
        if let Some((state, held)) = sources.field() {
            let key = (state.epoch, state.tick);
            if Some(key) > self.flowed {
                self.flowed = Some(key);
                if self.take_field(held.bytes())? {
                    self.flow = Some(held);
                }
            } else {
                self.life.page.add64(header::STALE, 1); // of a fluid that was replaced, and goes on
            }
        }
        match sources.looks.poll(system::now_ns()) {
            Some(Ok((scope, records))) => match spared(self.scenery.dress(self.renderer.stage(), scope, &records))? {
                Some(true) => {}
                Some(false) => sources.looks.want_others(),
                None => self.life.page.add64(header::INVALID, 1),
            },
            Some(Err(Senseless(tissue))) => self.life.refuse(tissue, Distrust::Invalid),
            None => {}
        }
        Ok(())
    }

    /// Shows a state of the tissue, if it can be; one that makes no sense is left out, counted, and said once.
    fn show_state(&mut self, sources: &mut Sources, state: &StreamHeader, bytes: &[u8]) -> Result<Taken, RenderError> {
        let moved = self.take_state(sources, state.topology_version, bytes);
        let news = self.refused[0].is_news(moved.is_err());
        match moved {
            Ok(true) => {
                self.shown = Some((state.epoch, state.tick));
                Ok(Taken::Shown)
            }
            Ok(false) => Ok(Taken::Waits),
            Err(Refused::Stage(error @ RenderError::DeviceLost(_))) => Err(error),
            Err(error) => {
                self.life.page.add64(header::INVALID, 1);
                if news {
                    self.life.say(&format!("a message is left out: {error}"));
                }
                Ok(Taken::LeftOut)
            }
        }
    }

    /// Whether the surfaces have moved: not before their topology is there.
    fn take_state(&mut self, sources: &mut Sources, version: u32, state: &[u8]) -> Result<bool, Refused> {
        let stage = self.renderer.stage();
        if !self.scenery.is_of(version) {
            let Some(topology) = sources.topology(self.life, version) else { return Ok(false) };
            self.copied = self.scenery.rebuild(stage, topology.bytes())?;
            sources.looks.want();
        }
        self.uploaded += self.scenery.follow(stage, state)?;
        Ok(true)
    }

    /// Moves the flakes on with the medium: as the newest state says that it flows or, where that says nothing, as fast as the inflow. A state by which they
    /// cannot be moved is counted, and not asked again.
    pub(super) fn drift(
        &mut self,
        sources: &Sources,
        sample: Option<&HardwareSample>,
        elapsed_s: f32,
    ) -> Result<(), RenderError> {
        let oblique_rad = self.scenery.instrument.scope.oblique_rad;
        let lens_m = sample.filter(|_| !self.switches.external).map(|sample| lens_m(&sample.pose, oblique_rad));
        let flow = self.flow.as_ref().and_then(|held| medium::flow(held.bytes()));
        let stage = self.renderer.stage();
        let uploaded = match flow {
            Some(flow) => self.motes.carry(stage, lens_m, &flow, elapsed_s),
            None => {
                let flow_ml_min = sources.pump().map_or(0.0, |pump| pump.inflow_ml_min);
                self.motes.drift(stage, lens_m, flow_ml_min, elapsed_s)
            }
        };
        // What was uploaded is no state of anybody.
        if spared(uploaded)?.is_none() && self.flow.take().is_some() {
            self.life.page.add64(header::INVALID, 1);
        }
        Ok(())
    }

    /// The medium as the newest fluid state has it; one that makes no sense leaves it as it was, and gives false.
    fn take_field(&mut self, state: &[u8]) -> Result<bool, RenderError> {
        let field = medium::field(state);
        let news = self.refused[1].is_news(field.is_err());
        let field = match field {
            Ok(field) => field,
            Err(error) => {
                self.life.page.add64(header::INVALID, 1);
                if news {
                    self.life.say(&format!("a state of the medium is left out: {error}"));
                }
                return Ok(false);
            }
        };
        let bytes = field.as_ref().map_or(0, |field| size_of_val(field.density) as u64);
        let bubbles = self.bubbles.show(self.renderer.stage(), medium::gas(state).unwrap_or_default());
        for uploaded in [self.renderer.set_fluid(field).map(|()| bytes), bubbles] {
            match spared(uploaded)? {
                Some(bytes) => self.uploaded += bytes,
                None => self.life.page.add64(header::INVALID, 1),
            }
        }
        self.scenery.blanch(self.renderer.stage(), medium::seals(state).unwrap_or_default());
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::ContactPlane;

    #[test]
    fn lines_of_meshes_that_cannot_be_drawn_are_missed_in_words_while_they_are_wanted() {
        let said = [(true, false), (true, true), (false, false)].map(|(wanted, drawn)| without_lines(wanted, drawn));
        assert_eq!(said, [Some(NO_LINES.to_string()), None, None]);
        assert!(NO_LINES.len() <= rendering::COLUMNS);
    }

    /// A stage that another engine's pieces had filled had no room for the flakes: each rendering ended with its first picture.
    #[test]
    fn what_the_stage_refuses_is_left_out_and_a_device_that_is_lost_is_the_end() {
        assert!(matches!(spared(Ok(7)), Ok(Some(7))));
        for refused in [
            RenderError::TooLarge { what: "objects", got: 273, bound: 272 },
            RenderError::BadField { got: 1, dims: [2; 3] },
            RenderError::UnknownObject(7),
        ] {
            assert!(matches!(spared::<u64>(Err(refused)), Ok(None)));
        }
        assert!(matches!(spared::<u64>(Err(RenderError::DeviceLost("x".into()))), Err(RenderError::DeviceLost(_))));
    }

    /// While the wire cut, each picture for whose state the topology came too late showed the state of the picture before.
    #[test]
    fn a_state_whose_topology_is_under_way_is_shown_by_the_next_picture_though_that_of_the_newest_is_again() {
        let (mut waiting, mut shown) = (None, Vec::new());
        // What has come, and from which state on the topology is missing.
        for (newest, missing_from) in
            [(Some(1), 9), (Some(2), 2), (Some(3), 3), (Some(4), 4), (None, 5), (Some(6), 6), (Some(7), 9)]
        {
            let mut last = None;
            let show = |state: &u32| {
                let can_be = *state < missing_from;
                last = last.or(can_be.then_some(*state));
                Ok(if can_be { Taken::Shown } else { Taken::Waits })
            };
            take_newest(newest, &mut waiting, show).unwrap();
            shown.push(last);
        }
        assert_eq!((shown, waiting), (vec![Some(1), None, Some(2), Some(3), Some(4), None, Some(7)], None));
    }

    #[test]
    fn a_state_that_makes_no_sense_stands_in_nobodys_way_and_waits_for_nothing() {
        let (mut waiting, mut shown) = (Some(4), None);
        let show = |state: &u32| match *state {
            5 => Ok(Taken::LeftOut),
            _ => {
                shown = Some(*state);
                Ok(Taken::Shown)
            }
        };
        take_newest(Some(5), &mut waiting, show).unwrap();
        assert_eq!((shown, waiting), (Some(4), None));
        let lost = take_newest(Some(6), &mut waiting, |_: &u32| Err(RenderError::DeviceLost("x".into())));
        assert!(matches!(lost, Err(RenderError::DeviceLost(_))));
        let mut newer = Some(7);
        take_newest(None, &mut newer, |_: &u32| Ok(Taken::Waits)).unwrap();
        assert_eq!(newer, Some(7), "without a new one it goes on waiting");
    }

    #[test]
    fn a_plane_that_the_tip_lies_behind_has_a_long_arrow_and_the_force_one_as_long_as_it_is_strong() {
        let mut input = InputRecord { applied_n: [0.0, 0.5, 0.0], ..InputRecord::default() };
        input.sample.pose.position_m = [0.0, 0.0, 0.03];
        input.model.plane_count = 99; // of a writer that cannot count
        input.model.planes[0] = ContactPlane { point_m: [0.0, 0.0, 0.029], normal: [0.0, 0.0, -1.0], ..ContactPlane::default() };
        input.model.planes[1] = ContactPlane { point_m: [0.0, 0.0, 0.031], normal: [0.0, 0.0, -1.0], ..ContactPlane::default() };
        input.model.planes[2] = ContactPlane { point_m: [0.0, 0.0, -0.37], normal: [0.0, 0.0, -1.0], ..ContactPlane::default() };
        let (planes, force) = arrows(&input);
        assert_eq!(planes.len(), input.model.planes.len());
        assert_eq!((planes[0].along_m[2], planes[1].along_m[2]), (-PLANE_M[0], -PLANE_M[1]));
        let from_m: Vec<f32> = planes[..3].iter().map(|plane| plane.from_m[2]).collect();
        let off_m = from_m.iter().zip([0.029, 0.031, 0.03 - FARTHEST_PLANE_M]).map(|(at, wanted)| (at - wanted).abs());
        assert!(off_m.fold(0.0, f32::max) < 1e-6, "one that is far is shown near the tip: {from_m:?}");
        assert_eq!((force.from_m, force.along_m), ([0.0, 0.0, 0.03], [0.0, 0.5 * FORCE_M_PER_N, 0.0]));
    }
}
