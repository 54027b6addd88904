//! The loop of the Vision Engine: thirty times a second, or more often where the machine manages it, the newest state, the tool, the text, one picture;
//! into the window, onto the disk, to the operator's page.

mod effort;
mod gather;

use crate::adapter;
use crate::album::Album;
use crate::display::{self, Asked, Display};
use crate::pulse::Pulse;
use crate::relay::Relay;
use crate::scenery::{BUBBLES, CONTACTS, FORCE, MOTES, Refusals, Scenery};
use crate::sources::Sources;
use crate::strip::Strip;
use crate::switches::Switches;
use hyst_engine::settings::SetError;
use hyst_engine::{Failure, Life, Pace, realtime};
use hyst_exchange::{Held, Links, system};
use hyst_messages::page::{ProcessState, header, rendering as page};
use hyst_messages::stream::ScopeRecord;
use hyst_messages::{HardwareSample, Pose, RenderingStatus, StreamHeader};
use rendering::{
    Bubbles, Camera, Effort, Endoscope, FrameStats, Gpu, Marks, Motes, Pane, Prefer, RenderError, Renderer, Shown, View,
    distortion, fastest_ticks, in_step,
};

/// Period of a process without pictures, ticks: it only shows that it lives.
const BLIND_TICKS: u64 = 50;
/// The lens lies this far behind the tip, m: the sheath reaches beyond it, as a resectoscope's does, so that one sees what the tip touches.
const LENS_BEHIND_M: f32 = 0.004;
/// An optic that looks farther aside than that, rad, would look into the sheath from there, and has its lens in the plane of the tip.
const STEEP_RAD: f32 = std::f32::consts::FRAC_PI_4;
/// Pictures that are made up for at once after a stall, so that there are as many in a second as there should be: of 0.1 s.
const BACKLOG: u64 = 3;
/// Time in which the exposure follows the light, s.
const ADAPTATION_S: f32 = 0.2;

/// Why the loop ended.
enum End {
    Stopped,
    NoWindow(String),
}

/// Everything that one graphics device draws with.
struct Vision<'a> {
    life: &'a Life,
    renderer: Renderer,
    scenery: Scenery,
    bubbles: Bubbles,
    motes: Motes,
    marks: Marks,
    view: View,
    switches: Switches,
    /// Focus where the device states none, and as it is set, m.
    usual_focus_m: f32,
    focus_m: f32,
    effort: Effort,
    fastest_ticks: u64,
    strip: Strip,
    /// Epoch and tick of the tissue's and the fluid's state that is shown.
    shown: Option<(u32, u64)>,
    /// A state of the tissue whose topology is under way.
    waiting: Option<(StreamHeader, Held)>,
    flowed: Option<(u32, u64)>,
    /// That state of the fluid, or the last one that made sense: its velocities carry the flakes of each picture until the next one comes.
    flow: Option<Held>,
    uploaded: u64,
    copied: u64,
    /// Of the tissue's messages and of the medium's states.
    refused: [Refusals; 2],
}

fn wants_external(life: &Life) -> Result<bool, SetError> {
    match life.settings.set.get("view").map(String::as_str) {
        None | Some("endoscope") => Ok(false),
        Some("external") => Ok(true),
        Some(value) => Err(SetError { key: "view".into(), value: value.into(), expected: "endoscope or external" }),
    }
}

/// The process.
pub fn run(life: &Life) -> Result<(), Failure> {
    rendering::spare_caught_panics();
    let mut switches = Switches::new(wants_external(life)?);
    let asked = display::asked(&life.settings)?;
    let mut album = Album::open(life)?;
    let ended = draw(life, asked, &mut switches, &mut album);
    album.close(life);
    ended
}

/// Draws until the station stops or something breaks.
fn draw(life: &Life, asked: Asked, switches: &mut Switches, album: &mut Album) -> Result<(), Failure> {
    let links = Links::join(&life.station, &life.slot.to_string())?;
    let mut relay = Relay::open(life, &links)?;
    let mut sources = Sources::open(life, links)?;
    life.ports_are_open();
    let mut display = {
        let _pulse = Pulse::start(life)?;
        Display::open(life, asked.size_px)
    };
    loop {
        let started = {
            let _pulse = Pulse::start(life)?;
            device(life, &display).and_then(|gpu| Vision::start(life, gpu, &display, asked, *switches))
        };
        let mut vision = match started {
            Ok(vision) => vision,
            Err(error @ (RenderError::NoVulkan(_) | RenderError::NoDevice { .. })) => {
                life.say(&format!("{error}; the station goes on without pictures"));
                return without_pictures(life);
            }
            Err(error @ (RenderError::NoDisplay(_) | RenderError::NoSurface { .. })) if display.pane().is_some() => {
                leave(life, &mut display, &error.to_string());
                continue;
            }
            Err(error) => return Err(adapter::broken(life, &error)),
        };
        let end = vision.show(&mut sources, &mut display, album, &mut relay)?;
        *switches = vision.switches;
        drop(vision);
        match end {
            End::Stopped => return Ok(()),
            End::NoWindow(reason) => leave(life, &mut display, &reason),
        }
    }
}

/// Opens the device that draws.
fn device(life: &Life, display: &Display) -> Result<Gpu, RenderError> {
    let order = adapter::order(&adapter::lost_ns(&life.station));
    if order[0] == Prefer::Software {
        life.say("two graphics devices were lost within a minute: the adapter in software is tried first");
    }
    let open = |prefer| display.pane().map_or_else(|| Gpu::new(prefer), |pane| Gpu::with_window(prefer, pane));
    adapter::first_of(order, open, |text| life.say(text))
}

/// Goes on without the window.
fn leave(life: &Life, display: &mut Display, reason: &str) {
    life.say(&format!("{reason}; headless"));
    display.close();
}

/// The process lives, so that nobody waits for it or restarts it; its status says that it has drawn nothing.
fn without_pictures(life: &Life) -> Result<(), Failure> {
    life.page.write(page::STATUS, &RenderingStatus::default());
    life.page.set_state(ProcessState::Live);
    let mut pace = Pace::new(life, BLIND_TICKS, 0);
    while pace.wait().is_some() {
        life.misbehave();
        pace.end();
    }
    Ok(())
}

/// Where the lens of an optic is, m.
fn lens_m(pose: &Pose, oblique_rad: f32) -> [f32; 3] {
    let axis = glam::Quat::from_array(pose.orientation) * glam::Vec3::Z;
    let behind_m = if oblique_rad > STEEP_RAD { 0.0 } else { LENS_BEHIND_M };
    (glam::Vec3::from(pose.position_m) - behind_m * axis).to_array()
}

/// How old the sample is that a picture shows, ns; `shown`: on the window, if there is one. Of a picture that nobody sees it says nothing.
fn motion_ns(sample: Option<&HardwareSample>, shown: Option<Shown>, now_ns: u64) -> Option<u64> {
    sample.filter(|_| shown != Some(Shown::Skipped)).map(|sample| now_ns.saturating_sub(sample.time_ns))
}

/// The light and the camera head's gain by a sample: inside those of the scope's `lamp` as far as it is turned up, outside those of a lamp that nobody turns.
/// `None` for as they were.
fn lit(sample: Option<&HardwareSample>, lamp: f32, is_external: bool) -> Option<[f32; 2]> {
    if is_external {
        return Some([1.0; 2]);
    }
    let turned_up = sample?.controls.light.clamp(0.0, 1.0);
    // The camera head makes up for less light, as far as it can without noise.
    Some([turned_up * lamp, turned_up.sqrt()])
}

/// The optic as the device says that it is held and focused; where the device states no focus it is another one.
fn held(optic: &ScopeRecord, sample: Option<&HardwareSample>, usual_focus_m: f32) -> Endoscope {
    let mut scope = Endoscope {
        oblique_rad: optic.oblique_rad,
        field_of_view_rad: optic.field_of_view_rad,
        distortion: distortion(optic.periphery_ratio),
        focus_m: usual_focus_m,
        ..Endoscope::default()
    };
    if let Some(sample) = sample {
        (scope.tip_m, scope.rotation) = (lens_m(&sample.pose, optic.oblique_rad), sample.pose.orientation);
        scope.head_rad = sample.pose.camera_roll_rad;
        scope.focus_m = sample.controls.focus_or(usual_focus_m);
    }
    scope
}

impl<'a> Vision<'a> {
    /// Draws a first picture, which compiles what drivers compile late.
    fn start(life: &'a Life, gpu: Gpu, display: &Display, asked: Asked, switches: Switches) -> Result<Vision<'a>, RenderError> {
        let name = gpu.name();
        let [width, height] = display::size_px(asked.size_px, gpu.is_software());
        let refresh_hz = display.pane().and_then(Pane::refresh_hz);
        let fastest_ticks = fastest_ticks(asked.hz, gpu.is_software(), system::cores(), refresh_hz);
        display.fit([width, height])?;
        let mut renderer = Renderer::new(gpu, width, height)?;
        let fastest_ticks = match in_step(fastest_ticks, refresh_hz) {
            Some(ticks) if renderer.keep_step() => ticks,
            _ => fastest_ticks,
        };
        let effort = effort::first(&life.settings, renderer.gpu().is_software(), fastest_ticks);
        let scenery = Scenery::new(renderer.stage())?;
        let mut vision = Vision {
            life,
            renderer,
            scenery,
            bubbles: Bubbles::new(BUBBLES),
            motes: Motes::new(MOTES),
            marks: Marks::new([CONTACTS, FORCE]),
            view: View::new(Camera::Endoscope(Endoscope::default())),
            switches,
            usual_focus_m: asked.focus_m,
            focus_m: asked.focus_m,
            effort,
            fastest_ticks,
            strip: Strip::of(life),
            shown: None,
            waiting: None,
            flowed: None,
            flow: None,
            uploaded: 0,
            copied: 0,
            refused: Default::default(),
        };
        vision.aim(None, 0.0);
        vision.set_quality();
        vision.renderer.render(&vision.view)?;
        life.say(&format!("{name}, {width}x{height}, at most {} pictures/s", 1_000 / fastest_ticks));
        Ok(vision)
    }

    fn show(
        &mut self,
        sources: &mut Sources,
        display: &mut Display,
        album: &mut Album,
        relay: &mut Relay,
    ) -> Result<End, Failure> {
        let life = self.life;
        let broken = |error: RenderError| adapter::broken(life, &error);
        sources.looks.want();
        let mut pace = Pace::new(life, self.effort.period_ticks, 0).with_backlog(BACKLOG);
        let (mut last_ns, mut is_under_way) = (system::now_ns(), false);
        while let Some(tick) = pace.wait() {
            let elapsed_s = (pace.woken_ns().saturating_sub(last_ns)) as f32 * 1e-9;
            last_ns = pace.woken_ns();
            life.misbehave();
            sources.helpers.look(life);
            sources.welcome();
            let sample = sources.sample();
            let given = sample.as_ref().map_or(0, |sample| sample.from_window);
            match display.input() {
                Ok(None) => {}
                Ok(Some(input)) => self.switches.press(&input, given),
                Err(reason) => return Ok(End::NoWindow(reason)),
            }
            display.go_on(self.strip.is_over());
            display.keep_size(&life.station, tick);
            self.gather(sources).map_err(broken)?;
            self.drift(sources, sample.as_ref(), elapsed_s).map_err(broken)?;
            self.view.adaptation = 1.0 - (-elapsed_s / ADAPTATION_S).exp();
            self.write(sources, tick, sample.as_ref(), display.pane().is_some());
            // What has come meanwhile: a picture lags behind the hand by what lies between its sample and the drawing.
            let sample = sources.sample().or(sample);
            self.aim(sample.as_ref(), sources.hold_m());
            let stats = self.renderer.render(&self.view).map_err(broken)?;
            self.strip.count(tick);
            life.drag(last_ns);
            self.report(&stats);
            let window_px = display.size_px();
            let shown = match window_px.map(|[width, height]| self.renderer.present(width, height)).transpose() {
                Ok(shown) => shown,
                Err(error @ RenderError::DeviceLost(_)) => return Err(broken(error)),
                Err(error) => return Ok(End::NoWindow(error.to_string())),
            };
            if let Some(age_ns) = motion_ns(sample.as_ref(), shown, system::now_ns()) {
                life.page.count_latency(page::MOTION, age_ns);
            }
            self.give_way(&stats, &mut pace);
            album.keep(life, tick, &mut self.renderer);
            relay.show(life, sources, tick, &mut self.renderer).map_err(broken)?;
            pace.end();
            life.page.set_state(ProcessState::Live);
            if self.shown.is_some() && !std::mem::replace(&mut is_under_way, true) {
                realtime::draw(life);
                if let Err(error) = self.renderer.make_rest() {
                    life.say(&format!("{error}: what is drawn for the first time is made by the picture that needs it"));
                }
            }
        }
        Ok(End::Stopped)
    }

    /// Points the camera and sets its focus, moves the tool, whose jaws hold something at such an opening, m, sets the light.
    fn aim(&mut self, sample: Option<&HardwareSample>, hold_m: f32) {
        if let Some(sample) = sample {
            // The tool is on the stage from the start.
            let _ = self.scenery.instrument.hold(self.renderer.stage(), sample, hold_m);
        }
        if let Some([light, gain]) = lit(sample, self.scenery.instrument.scope.light, self.switches.external) {
            (self.view.light, self.view.gain) = (light, gain);
        }
        let scope = held(&self.scenery.instrument.scope, sample, self.usual_focus_m);
        self.focus_m = scope.focus_m;
        self.view.camera = match self.switches.external {
            true => Camera::External(self.switches.outside()),
            false => Camera::Endoscope(scope),
        };
        self.view.has_lines = self.switches.has_lines();
    }

    fn report(&self, stats: &FrameStats) {
        let own = &self.life.page;
        let frames = own.load64(header::STEPS) + 1; // one for each step, over all devices of this life
        let scale = self.view.quality.scale;
        let status = RenderingStatus {
            frames,
            upload_bytes: self.uploaded,
            copied_bytes: self.copied,
            frame_ms: stats.total_ms,
            scale,
            passes_ms: stats.passes_ms,
            size_px: self.renderer.size_px(),
            period_ticks: [self.effort.period_ticks, self.fastest_ticks].map(|ticks| ticks as u32),
            focus_m: if self.view.quality.focus && !self.switches.external { self.focus_m } else { 0.0 },
            shown_tick: self.shown.map_or(0, |(_, tick)| tick),
        };
        own.write(page::STATUS, &status);
        own.store64(header::VALUE_NS, system::now_ns());
        own.add64(header::COPIED_BYTES, self.copied);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With the scope's lamp turned down the organ was dark from outside as well.
    #[test]
    fn the_lamp_of_the_scope_lights_what_the_scope_sees_and_the_view_from_outside_has_one_of_its_own() {
        let mut sample = HardwareSample::default();
        sample.controls.light = 0.25;
        let [inside, outside] = [false, true].map(|is_external| lit(Some(&sample), 0.5, is_external));
        assert_eq!((inside, outside), (Some([0.125, 0.5]), Some([1.0, 1.0])));
        assert_eq!([false, true].map(|is_external| lit(None, 0.0, is_external)), [None, Some([1.0, 1.0])]);
    }

    #[test]
    fn the_picture_has_the_head_and_the_focus_of_the_sample_that_it_shows() {
        let optic = ScopeRecord::default();
        let mut sample = HardwareSample::default();
        (sample.pose.camera_roll_rad, sample.controls.focus_m) = (0.4, 0.008);
        let seen = |sample: Option<&HardwareSample>| {
            let scope = held(&optic, sample, 0.015);
            (scope.head_rad, scope.focus_m)
        };
        assert_eq!((seen(Some(&sample)), seen(None)), ((0.4, 0.008), (0.0, 0.015)));
        for focus_m in [0.0, f32::NAN, 8.0] {
            sample.controls.focus_m = focus_m;
            assert_eq!(seen(Some(&sample)), (0.4, 0.015), "{focus_m} m: a driver or a recording that states none");
        }
    }

    /// From 4 mm behind the tip an optic of 70° with a field of 90° looked into the sheath, which is not drawn.
    #[test]
    fn the_lens_lies_behind_the_tip_and_that_of_an_optic_which_looks_aside_in_its_plane() {
        let pose = Pose { position_m: [0.001, 0.002, 0.03], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        for (degrees, z_m) in [(0.0_f32, 0.026), (12.0, 0.026), (30.0, 0.026), (70.0, 0.03)] {
            let optic = ScopeRecord { oblique_rad: degrees.to_radians(), ..ScopeRecord::default() };
            let sample = HardwareSample { pose, ..HardwareSample::default() };
            let [x, y, z] = held(&optic, Some(&sample), 0.015).tip_m;
            assert!([x, y] == [0.001, 0.002] && (z - z_m).abs() < 1e-7, "{degrees}: {z}");
        }
    }

    /// A picture on a window that is hidden was counted as one that somebody saw.
    #[test]
    fn from_motion_to_picture_counts_the_sample_that_is_shown_and_no_picture_that_nobody_sees() {
        let sample = HardwareSample { time_ns: 1_000, ..HardwareSample::default() };
        let of = |sample, shown| motion_ns(sample, shown, 4_000);
        assert_eq!(
            [None, Some(Shown::Yes), Some(Shown::Skipped)].map(|shown| of(Some(&sample), shown)),
            [Some(3_000), Some(3_000), None]
        );
        assert_eq!((of(None, None), motion_ns(Some(&sample), None, 999)), (None, Some(0)));
    }
}
