//! A station on this machine: its name, its root on tmpfs, its pages. Two stations never meet, because everything that they make
//! lies under their own root or bears their own prefix.

use crate::page::{self, OwnedPage, PageError, ReadPage};
use crate::system;
use hyst_messages::page::{Swap, station as layout, words_of};
use hyst_messages::{Role, SLOTS, Slot, TICK_NS};
use std::path::{Path, PathBuf};

/// Longest name of a station, so that every path and service name fits.
pub const MAX_NAME: usize = 24;

/// Why a station cannot be addressed.
#[derive(Debug, thiserror::Error)]
pub enum StationError {
    /// Not a name.
    #[error("station name {0:?}: use 1 to {MAX_NAME} of the letters a-z, digits and '-'")]
    Name(String),
    /// The root cannot be made.
    #[error("station root {path}: {source}; look at `df /dev/shm` and at the rights of that folder")]
    Root {
        /// The root.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A page.
    #[error(transparent)]
    Page(#[from] PageError),
}

/// Where a station keeps its things.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Station {
    name: String,
    root: PathBuf,
}

impl Station {
    /// The station of this user with this name.
    pub fn named(name: &str) -> Result<Station, StationError> {
        let good = (1..=MAX_NAME).contains(&name.len())
            && name.bytes().all(|byte| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-');
        if !good {
            return Err(StationError::Name(name.to_string()));
        }
        let root = PathBuf::from(format!("/dev/shm/hystation-{}-{name}", system::user_id()));
        Ok(Station { name: name.to_string(), root })
    }
    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Its root on tmpfs; everything but iceoryx2's segments lies below.
    pub fn root(&self) -> &Path {
        &self.root
    }
    /// Prefix of the segments in /dev/shm.
    pub fn prefix(&self) -> String {
        format!("hyst{}_{}_", system::user_id(), self.name)
    }
    /// The page of an incarnation in a slot.
    pub fn slot_page(&self, slot: Slot, incarnation: u32) -> PathBuf {
        self.root.join(format!("pages/{:02}-{incarnation}.page", slot.number()))
    }
    /// The station's own page.
    pub fn station_page(&self) -> PathBuf {
        self.root.join("pages/station.page")
    }
    /// The roster's page.
    pub fn roster_page(&self) -> PathBuf {
        self.root.join("pages/roster.page")
    }
    /// Configuration of iceoryx2 for this station.
    pub fn link_config(&self) -> PathBuf {
        self.root.join("link.toml")
    }
    /// The control socket.
    pub fn control_socket(&self) -> PathBuf {
        self.root.join("control.sock")
    }
    /// What the run consists of.
    pub fn plan(&self) -> PathBuf {
        self.root.join("plan.toml")
    }
    /// What is known of the newest swap.
    pub fn swap(&self) -> PathBuf {
        self.root.join("swap.json")
    }
    /// The log of a slot's processes.
    pub fn log(&self, slot: Slot) -> PathBuf {
        self.root.join(format!("logs/{slot}.log"))
    }
    /// What happened, a line for each event, appended by the supervisor and the guardian.
    pub fn events(&self) -> PathBuf {
        self.root.join("events.log")
    }
    /// What the engines were started with: the command line's settings, as TOML.
    pub fn settings(&self) -> PathBuf {
        self.root.join("settings.toml")
    }
    /// The station's own copy of the case that it runs, with its seed, if it runs one: whoever edits the file that was named changes nothing here.
    pub fn case(&self) -> PathBuf {
        self.root.join("case.toml")
    }
    /// The station's own copy of the files of its scene: whoever edits those that were named changes nothing here.
    pub fn scene(&self) -> PathBuf {
        self.root.join("scene")
    }
    /// The case in the scene of that copy.
    pub fn scene_case(&self) -> PathBuf {
        self.root.join("scene.case.toml")
    }
    /// The path of what engines load of that copy; no such file where there is none.
    pub fn scene_entry(&self) -> PathBuf {
        self.root.join("scene.path")
    }
    /// By which build it was founded, 16 hexadecimal digits, if it is recorded.
    pub fn build(&self) -> PathBuf {
        self.root.join("build")
    }
    /// Bytes that the disk of the recording has left, as its recorder was told last: digits. Not there while nobody knows.
    pub fn room(&self) -> PathBuf {
        self.root.join("room")
    }
    /// Where the scene has its pivot, for drivers, whose tips are about it: three floats, m. A place without a scene has none.
    pub fn pivot(&self) -> PathBuf {
        self.root.join("pivot")
    }
    /// What stands there; the origin where nothing does.
    pub fn pivot_m(&self) -> [f32; 3] {
        let bytes = std::fs::read(self.pivot()).unwrap_or_default();
        let coordinate = |axis: usize| -> Option<[u8; 4]> { bytes.get(4 * axis..4 * axis + 4)?.try_into().ok() };
        std::array::from_fn(|axis| coordinate(axis).map_or(0.0, f32::from_ne_bytes))
    }
    /// How much pathology of the scene is to be removed, ml: digits.
    pub fn pathology(&self) -> PathBuf {
        self.root.join("pathology")
    }
    /// What the case is judged by, as JSON.
    pub fn brief(&self) -> PathBuf {
        self.root.join("case.json")
    }
    /// The referee's judgement so far, as JSON; of a replay that begins later at first that of what was before.
    pub fn judged(&self) -> PathBuf {
        self.root.join("judged.json")
    }
    /// The judgement of the recorder's own referee so far, as JSON, which is there whether somebody else judges or not.
    pub fn recorder_judged(&self) -> PathBuf {
        self.root.join("recorder-judged.json")
    }
    /// What the recorder has seen of the processes, as JSON, up to where its file may not have it yet.
    pub fn recorder_seen(&self) -> PathBuf {
        self.root.join("recorder-seen.json")
    }
    /// The supervisor's report so far, as JSON, once a second.
    pub fn report(&self) -> PathBuf {
        self.root.join("report.json")
    }

    /// Makes root, pages and link configuration. The root must not exist.
    pub fn found(&self) -> Result<(), StationError> {
        let refused = |source| StationError::Root { path: self.root.clone(), source };
        use std::os::unix::fs::DirBuilderExt;
        std::fs::DirBuilder::new().mode(0o700).create(&self.root).map_err(refused)?;
        for folder in ["pages", "logs", "iox2"] {
            std::fs::create_dir(self.root.join(folder)).map_err(refused)?;
        }
        std::fs::write(self.link_config(), self.link_toml()).map_err(refused)?;
        let station = page::create(&self.station_page(), layout::WORDS, SLOTS, 0)?;
        station.store64(layout::T0_NS, system::now_ns());
        station.store64(layout::NEXT_INCARNATION, 1);
        station.store32(layout::READY, 1);
        page::create(&self.roster_page(), hyst_messages::page::roster::WORDS, SLOTS, 0)?;
        Ok(())
    }

    /// iceoryx2's configuration: own root and prefix, no automatic clean-up anywhere. Who opens a service would clean up after the dead that have it open (0.10, if not
    /// told otherwise): a newborn whose supervisor had died lost its services by that, before it had opened them and before the next supervisor held them.
    fn link_toml(&self) -> String {
        let (root, prefix) = (self.root.display(), self.prefix());
        format!(
            "[global]\nroot-path = \"{root}/iox2\"\nprefix = \"{prefix}\"\n\n[global.node]\n\
             cleanup-dead-nodes-on-creation = false\ncleanup-dead-nodes-on-destruction = false\n\n\
             [global.service]\ncleanup-dead-nodes-on-open = false\n"
        )
    }

    /// The segments in /dev/shm.
    fn segments(&self) -> impl Iterator<Item = std::fs::DirEntry> {
        let prefix = self.prefix();
        let entries = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        entries.filter(move |entry| entry.file_name().to_string_lossy().starts_with(&prefix))
    }

    /// Segments without a size: being made at this moment, or left so by a maker that died between the two calls that make one. Who opens such a segment
    /// (iceoryx2 0.10, a sender its connection to a receiver) waits for its size without a bound, so somebody has to remove those of the dead.
    pub fn unborn_segments(&self) -> Vec<PathBuf> {
        let is_empty = |entry: &std::fs::DirEntry| entry.metadata().is_ok_and(|data| data.is_file() && data.len() == 0);
        self.segments().filter(is_empty).map(|entry| entry.path()).collect()
    }

    /// Segments, files and folders that exist of this station.
    pub fn leftovers(&self) -> Vec<PathBuf> {
        let root = self.root.exists().then(|| self.root.clone());
        self.segments().map(|entry| entry.path()).chain(root).collect()
    }

    /// Removes everything of the station. Only when nothing of it lives.
    pub fn wipe(&self) {
        for path in self.leftovers() {
            // What cannot be removed is seen by the next `leftovers`.
            let _ = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        }
    }

    /// The station's page for reading.
    pub fn open(&self) -> Result<StationPage, StationError> {
        Ok(StationPage { page: ReadPage::open(&self.station_page(), layout::WORDS)? })
    }
    /// The station's page for its keepers.
    pub fn open_for_keeping(&self) -> Result<OwnedPage, StationError> {
        Ok(OwnedPage::open(&self.station_page(), layout::WORDS)?)
    }
    /// The page of a slot's incarnation, for reading.
    pub fn read_slot(&self, slot: Slot, incarnation: u32) -> Result<ReadPage, PageError> {
        ReadPage::open(&self.slot_page(slot, incarnation), words_of(slot.role()))
    }
    /// The page of a slot's incarnation, for its owner.
    pub fn own_slot(&self, slot: Slot, incarnation: u32) -> Result<OwnedPage, PageError> {
        OwnedPage::open(&self.slot_page(slot, incarnation), words_of(slot.role()))
    }
    /// Mends the header of the page of an incarnation that lives; true if it was damaged. The supervisor's work: a newcomer can map no page with a damaged
    /// header, and its owner, who has mapped it, does not look at that again.
    pub fn mend_slot(&self, slot: Slot, incarnation: u32) -> Result<bool, PageError> {
        let page = OwnedPage::open_damaged(&self.slot_page(slot, incarnation), words_of(slot.role()))?;
        Ok(page.mend_header(slot.number(), incarnation))
    }
    /// Makes the page of a new incarnation.
    pub fn create_slot(&self, slot: Slot, incarnation: u32) -> Result<OwnedPage, PageError> {
        page::create(&self.slot_page(slot, incarnation), words_of(slot.role()), slot.number(), incarnation)
    }
}

/// The station's page, read-only.
#[derive(Debug)]
pub struct StationPage {
    page: ReadPage,
}

impl StationPage {
    /// Start of tick 0, ns.
    pub fn t0_ns(&self) -> u64 {
        self.page.load64(layout::T0_NS)
    }
    /// Tick at a time.
    pub fn tick_at(&self, time_ns: u64) -> u64 {
        time_ns.saturating_sub(self.t0_ns()) / TICK_NS
    }
    /// Start of a tick, ns; of one that no clock comes to, the end of all time.
    pub fn start_of(&self, tick: u64) -> u64 {
        self.t0_ns().saturating_add(tick.saturating_mul(TICK_NS))
    }
    /// Whether the station runs on a virtual clock.
    pub fn is_lockstep(&self) -> bool {
        self.page.load32(layout::LOCKSTEP) != 0
    }
    /// The station's present tick: by its clock, or in lock-step the tick that was last ended.
    pub fn present_tick(&self) -> u64 {
        if self.is_lockstep() { self.page.load64(layout::ENDED_TICK) } else { self.tick_at(system::now_ns()) }
    }
    /// The latest tick of which there can be a state: the present one, or in lock-step that to which the sequencer has let anybody go.
    pub fn latest_tick(&self) -> u64 {
        let begun = |word: usize| if self.is_lockstep() { self.page.load64(word) } else { 0 };
        self.present_tick().max(begun(layout::BEGUN_TICK)).max(begun(layout::TISSUE_TICK))
    }
    /// Whether everything must stop.
    pub fn stop_requested(&self) -> bool {
        self.page.load32(layout::STOP) != 0
    }
    /// Whether faults may be injected.
    pub fn test_mode(&self) -> bool {
        self.page.load32(layout::TEST_MODE) != 0
    }
    /// Number of collision workers.
    pub fn workers(&self) -> usize {
        self.page.load32(layout::WORKERS) as usize
    }
    /// Incarnation in a slot, 0 if none.
    pub fn incarnation(&self, slot: Slot) -> u32 {
        self.page.load32(layout::SLOT_INCARNATION + slot.number())
    }
    /// Process in a slot, 0 if none.
    pub fn pid(&self, slot: Slot) -> u32 {
        self.page.load32(layout::SLOT_PID + slot.number())
    }
    /// Whether the process in the slot is known to be dead.
    pub fn is_dead(&self, slot: Slot) -> bool {
        self.page.load32(layout::SLOT_DEAD + slot.number()) != 0
    }
    /// Whether the supervisor's watch found that the incarnation in the slot hangs, and that no other is to blame for it.
    pub fn is_suspect(&self, slot: Slot, incarnation: u32) -> bool {
        incarnation != 0 && self.page.load32(layout::SLOT_SUSPECT + slot.number()) == incarnation
    }
    /// The newest tick of a checkpoint that a founder of the role may go on from.
    pub fn ground_tick(&self, role: Role) -> u64 {
        match self.page.load64(layout::GROUND + role as usize) {
            0 => u64::MAX,
            tick => tick,
        }
    }
    /// Whether the role's state is held still.
    pub fn is_held(&self, role: Role) -> bool {
        self.page.load32(layout::HELD + role as usize) != 0
    }
    /// The newcomer of a role that is on trial.
    pub fn swap(&self, role: Role) -> Swap {
        Swap::from_word(self.page.load64(layout::SWAP + role as usize))
    }
    /// Hash of the scene that the station was started with; 0 if nobody said.
    pub fn scene_hash(&self) -> u64 {
        self.page.load64(layout::SCENE_HASH)
    }
    /// Incarnations below this number have been given out.
    pub fn next_incarnation(&self) -> u64 {
        self.page.load64(layout::NEXT_INCARNATION)
    }
    /// Counts the changes of the slots.
    pub fn changes(&self) -> u32 {
        self.page.load32(layout::CHANGES)
    }
    /// Waits for a change of the slots.
    pub fn wait_for_change(&self, seen: u32, deadline_ns: u64) {
        self.page.wait(layout::CHANGES, seen, deadline_ns);
    }
    /// The page itself, for what has no name here.
    pub fn page(&self) -> &ReadPage {
        &self.page
    }
    /// All slots of a role that have an incarnation.
    pub fn occupied(&self, role: Role) -> impl Iterator<Item = (Slot, u32)> + '_ {
        (0..role.slots().1).filter_map(move |index| {
            let slot = Slot::new(role, index)?;
            let incarnation = self.incarnation(slot);
            (incarnation != 0).then_some((slot, incarnation))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_break_paths_are_refused() {
        for bad in ["", "A", "a/b", "a b", "..", &"x".repeat(25), "ä"] {
            assert!(matches!(Station::named(bad), Err(StationError::Name(_))), "{bad}");
        }
    }

    #[test]
    fn a_page_whose_header_was_damaged_is_mended_so_that_newcomers_can_map_it() {
        use hyst_messages::page::header;
        let station = Station::named(&format!("t{}-headers", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(Role::Device);
        let own = station.create_slot(slot, 7).unwrap();
        let mapped = station.read_slot(slot, 7).unwrap();
        assert!(mapped.has_header(slot.number(), 7) && !station.mend_slot(slot, 7).unwrap());
        for word in [header::MAGIC, header::SLOT, header::INCARNATION] {
            own.store64(word, own.load64(word) ^ 1 << 9);
            assert!(!mapped.has_header(slot.number(), 7));
            assert_eq!(station.read_slot(slot, 7).is_err(), word == header::MAGIC);
            assert!(station.mend_slot(slot, 7).unwrap() && mapped.has_header(slot.number(), 7));
            assert_eq!(station.read_slot(slot, 7).unwrap().incarnation(), 7);
        }
        assert!(station.mend_slot(slot, 8).is_err(), "nobody was born as that");
        let kept = station.open_for_keeping().unwrap();
        let t0_ns = kept.load64(layout::T0_NS);
        kept.store64(header::MAGIC, 7);
        assert!(station.open().is_err() && kept.mend_magic() && !kept.mend_magic());
        assert_eq!(station.open().unwrap().t0_ns(), t0_ns);
        station.wipe();
    }

    #[test]
    fn a_station_is_founded_once_and_wiped_without_leftovers() {
        let station = Station::named(&format!("t{}-found", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert!(matches!(station.found(), Err(StationError::Root { .. })), "a second station of one name");
        let page = station.open().unwrap();
        assert_eq!(page.tick_at(page.start_of(41) + 5), 41);
        station.wipe();
        assert_eq!(station.leftovers(), Vec::<PathBuf>::new());
    }
}
