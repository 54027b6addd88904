//! A cell of a campaign: one kind of fault on one target in one state of the station, and what is promised there. Cells that cannot be are
//! refused with the reason.

mod companion;
mod listed;

use super::file::{Arm, Campaign, Pool};
use crate::fault::DEVICE_TICKS;
use crate::faultfile::{DEFAULT_TIMES, FaultKind, Injection, Keepers, Place, Target, Which};
use crate::{plan, policy};
use hyst_engine::Settings;
use hyst_messages::{MAX_WORKERS, Role, Slot};
pub(super) use listed::names;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};

/// What the station is doing when the fault comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Whatever it does at the drawn tick.
    Any,
    /// Whole, and the tool touches nothing.
    Idle,
    /// Whole, and the tool touches tissue.
    Contact,
    /// Whole, and the electrode cuts.
    Cutting,
    /// Another fault's recovery is under way.
    Recovery,
    /// A swap is under way.
    Swap,
    /// Who does a role's work is to be replaced, or was, and nobody is ready in its place yet.
    Handover,
}

impl State {
    /// All of them with their names.
    pub const ALL: [(State, &'static str); 7] = [
        (State::Any, "any"),
        (State::Idle, "idle"),
        (State::Contact, "contact"),
        (State::Cutting, "cutting"),
        (State::Recovery, "recovery"),
        (State::Swap, "swap"),
        (State::Handover, "handover"),
    ];
    /// The state that a word names.
    pub fn parse(text: &str) -> Result<State, String> {
        let found = State::ALL.iter().find(|(_, name)| *name == text).map(|(state, _)| *state);
        found.ok_or_else(|| format!("state {text:?}: there are any, idle, contact, cutting, recovery, swap and handover"))
    }
    fn suffix(self) -> &'static str {
        match self {
            State::Any => "",
            State::Idle => " idle",
            State::Contact => " in contact",
            State::Cutting => " cutting",
            State::Recovery => " in recovery",
            State::Swap => " in a swap of",
            State::Handover => " in a hand-over",
        }
    }
}

/// What a fault may bring about in its cell, although it is a broken promise in every other; it is counted there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum May {
    /// A state of tissue or fluid goes on from an older one.
    BeginAnew,
    /// Other processes die of it.
    OthersDie,
    /// The station ends; another is started for the faults that are left.
    StationEnds,
}

/// Longest time within which hangs may be asked to be found, ms: what hangs is ended long before.
const MOST_FOUND_MS: f64 = 60_000.0;

/// Cells as the file has them: every kind × every target × every state.
#[derive(Debug, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Group {
    /// Kinds of faults, at least one; of all but cont and undo, which end what another one does.
    #[schemars(with = "Vec<FaultKind>")]
    kinds: Vec<String>,
    /// To whom, as for `fault inject`: `haptic:active`, `collision-worker:0`, `tissue:both`, `fluid:newcomer`, `supervisor`; at least one.
    targets: Vec<String>,
    /// What the station is doing when the fault comes. Default: any.
    #[serde(default = "any")]
    #[schemars(with = "Vec<State>")]
    states: Vec<String>,
    /// Faults of each cell in an arm of share 1, above 0.
    count: usize,
    /// Limit of the one-sided upper 95 % bound of the faults with excess misses, per fault. Default: none of its own in a pool, else the file's.
    limit_upper95: Option<f64>,
    /// The pool that it is judged in. Default: by itself.
    pool: Option<String>,
    /// The arms that it is in. Default: all.
    #[serde(default)]
    arms: Vec<String>,
    /// Misses beyond the control's that each of these faults may cost, ticks. Default: 20 for each device that ends, else none.
    allowed_misses: Option<u64>,
    /// Half of those that hang are to be found within this time, above 0 to 60 000 ms. Default: that is not judged.
    found_ms: Option<f64>,
    /// Of state recovery: the fault in whose recovery this one comes, as KIND TARGET and options. Default: a kill of the tissue, of a servo where the tissue
    /// is the target. Of state handover: the one for which a role is handed over. Default: its holder's usher is blocked, of a target that hands nothing over the
    /// tissue's.
    with: Option<String>,
    /// Of state swap: the role that is swapped meanwhile. Default: fluid.
    swap: Option<String>,
    /// What else it may bring about, which is counted and breaks no promise. Default: nothing.
    #[serde(default)]
    may: Vec<May>,
    /// Options of the faults, as `fault inject` and a file for `--faults` take them.
    #[serde(flatten)]
    #[schemars(schema_with = "options")]
    options: toml::Table,
}

fn any() -> Vec<String> {
    vec!["any".into()]
}

/// Keys of a fault that a cell's own stand for.
const OF_THE_CELL: [&str; 5] = ["kind", "target", "tick", "phase_us", "allowed_misses"];

/// What a fault may say beyond them.
fn options(generator: &mut SchemaGenerator) -> Schema {
    let mut schema = Injection::json_schema(generator);
    let properties = schema.get_mut("properties").and_then(|properties| properties.as_object_mut());
    if let Some(properties) = properties {
        properties.retain(|key, _| !OF_THE_CELL.contains(&key.as_str()));
    }
    schema.remove("required"); // all of them are the cell's
    schema
}

/// One cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// `kill haptic:active in contact`.
    pub name: String,
    /// What is injected; its tick is drawn.
    pub injection: Injection,
    /// In which state.
    pub state: State,
    /// How often in an arm of share 1.
    pub count: usize,
    /// Its own limit; a cell in a pool may have none.
    pub limit_upper95: Option<f64>,
    /// The pool that it is judged in.
    pub pool: Option<String>,
    /// The arms that it is in; empty: in all.
    pub arms: Vec<String>,
    /// Misses beyond the control's that this fault may cost: 20 ms for each device that ends, else none.
    pub allowed_misses: u64,
    /// Half of those that hang are to be found within this time, ms.
    pub found_ms: Option<f64>,
    /// The fault in whose recovery, or hand-over, this one comes.
    pub with: Option<Injection>,
    /// The role that is swapped meanwhile.
    pub swap: Option<Role>,
    /// What else it may bring about.
    pub may: Vec<May>,
}

/// Whether a limit makes sense; one below 0 cannot be met, which shows that a verdict can fail.
pub fn check_limit(limit: f64) -> Result<(), String> {
    if (-1.0..=1.0).contains(&limit) {
        Ok(())
    } else {
        Err(format!("limit_upper95 = {limit}: faults with excess misses, per fault, -1 to 1"))
    }
}

impl Group {
    /// Its cells, or what is wrong with one of them.
    pub fn cells(self, limit_upper95: f64, pools: &[Pool]) -> Result<Vec<Cell>, String> {
        if self.kinds.is_empty() || self.targets.is_empty() || self.states.is_empty() || self.count == 0 {
            return Err("kinds, targets, states and count: none of them may be empty or 0".into());
        }
        self.limit_upper95.map_or(Ok(()), check_limit)?;
        if let Some(found_ms) = self.found_ms.filter(|found_ms| !(*found_ms > 0.0 && *found_ms <= MOST_FOUND_MS)) {
            return Err(format!(
                "found_ms = {found_ms}: within this time half of the hangs are to be found, above 0 to {MOST_FOUND_MS} ms"
            ));
        }
        if let Some(pool) = self.pool.as_ref().filter(|pool| !pools.iter().any(|known| known.name == **pool)) {
            return Err(format!("pool {pool:?}: there is no [[pool]] of this name"));
        }
        let mut cells = Vec::new();
        for kind in &self.kinds {
            for target in &self.targets {
                for state in &self.states {
                    cells.push(self.cell(kind, target, State::parse(state)?, limit_upper95)?);
                }
            }
        }
        Ok(cells)
    }

    fn cell(&self, kind: &str, target: &str, state: State, limit_upper95: f64) -> Result<Cell, String> {
        let with = match (state, &self.with) {
            (State::Recovery, text) => Some(companion::in_recovery(text.as_deref(), target)?),
            (State::Handover, text) => Some(companion::in_handover(text.as_deref(), target)?),
            (_, Some(_)) => {
                return Err("with: only a cell with state \"recovery\" or \"handover\" has another fault beside it".into());
            }
            _ => None,
        };
        let swap = match (state, self.swap.as_deref()) {
            (State::Swap, role) => Some(swapped(role.unwrap_or(Role::Fluid.name()), target)?),
            (_, Some(_)) => return Err("swap: only a cell with state \"swap\" has one beside it".into()),
            _ => None,
        };
        if is_of_newcomer(target) && Target::parse(target).map(|target| target.role) != swap {
            return Err(format!("{target}: only a swap of its role brings one; write states = [\"swap\"] and swap = ROLE"));
        }
        let options: String = self.options.iter().map(|(key, value)| format!(" {key}={value}")).collect();
        // Its own death, and that of the old one which a swap ends.
        let devices_ended =
            [Some(Role::name_in(target)), swap.map(Role::name)].into_iter().filter(|name| *name == Some(Role::Device.name()));
        let device_ticks = devices_ended.count() as u64 * DEVICE_TICKS;
        let what = injection(kind, target, &self.options)?;
        for hurt in std::iter::once(&what).chain(&with) {
            comes_back(hurt, &self.may)?;
        }
        let beside = swap.map(|role| format!(" {}", role.name())).unwrap_or_default();
        let from = self.with.as_ref().map(|with| format!(" from {with}")).unwrap_or_default();
        Ok(Cell {
            name: format!("{kind} {target}{}{beside}{from}{options}", state.suffix()),
            injection: what,
            state,
            count: self.count,
            limit_upper95: self.limit_upper95.or(if self.pool.is_some() { None } else { Some(limit_upper95) }),
            pool: self.pool.clone(),
            arms: self.arms.clone(),
            allowed_misses: self.allowed_misses.unwrap_or(device_ticks),
            found_ms: self.found_ms,
            with,
            swap,
            may: self.may.clone(),
        })
    }
}

/// The role of a swap that faults may fall into.
fn swapped(name: &str, target: &str) -> Result<Role, String> {
    let role = crate::swap::role_of(name).map_err(|reason| format!("swap: {reason}"))?;
    match Keepers::parse(target) {
        Some(keepers) if keepers != Keepers::Supervisor => Err(format!("{target} in a swap: take supervisor, which undoes it")),
        _ => Ok(role),
    }
}

/// The injection that a cell's keys say, checked as one from the command line.
fn injection(kind: &str, target: &str, options: &toml::Table) -> Result<Injection, String> {
    let refused = |why: &str| Err(format!("kind {kind:?} {why}"));
    match FaultKind::from_name(kind) {
        None => {
            let known: Vec<&str> = FaultKind::ALL.iter().map(|(_, name, _)| *name).collect();
            return Err(format!("kind {kind:?}: there are {}", known.join(", ")));
        }
        Some(FaultKind::Cont) => {
            return refused("continues a process that is stopped, and none is; write kind \"stop\" with for = SECONDS");
        }
        Some(FaultKind::Undo) => {
            return refused(
                "ends what was done to a process for a time, and nothing is; a fault with for = SECONDS ends by itself",
            );
        }
        Some(_) => {}
    }
    let mut table = options.clone();
    for key in OF_THE_CELL {
        if table.insert(key.into(), toml::Value::Integer(0)).is_some() {
            return Err(format!("key {key:?}: a cell says once whom it hurts and what that may cost, and its ticks are drawn"));
        }
    }
    table.insert("kind".into(), kind.into());
    table.insert("target".into(), target.into());
    let read: Injection = table.try_into().map_err(|e: toml::de::Error| e.message().to_string())?;
    let injection = Injection { allowed_misses: None, ..read }; // the cell's, which its station is told with each fault
    injection.check()?;
    Ok(injection)
}

/// Refuses a fault of starts after which nobody comes back, by design: there is nothing to be judged.
fn comes_back(injection: &Injection, may: &[May]) -> Result<(), String> {
    let is_of_start = injection.kind.mischief().is_some_and(|what| what.is_of_start());
    let Some(Target { role, which }) = Target::parse(&injection.target).filter(|_| is_of_start) else { return Ok(()) };
    let (kind, target) = (injection.kind.name(), &injection.target);
    if which == Which::Newcomer && Slot::guest(role).is_some() {
        return Err(format!(
            "{kind} {target}: it has no successor whose start could be hindered, for its swap is undone; take kill"
        ));
    }
    let most = policy::limits(role).most_short_lives;
    let times = injection.times.unwrap_or(DEFAULT_TIMES);
    if injection.kind == FaultKind::CrashLoop && times >= most && !may.contains(&May::StationEnds) {
        return Err(format!(
            "{kind} {target}: times = {times}: after {most} short lives in a row its place is given up by design; take fewer, or \
             may = [\"station-ends\"]"
        ));
    }
    Ok(())
}

/// Whether a target is the process that a swap brings.
fn is_of_newcomer(target: &str) -> bool {
    Target::parse(target).is_some_and(|target| target.which == Which::Newcomer)
}

impl Cell {
    /// Faults that the station tells of once it is injected: one for each process that is hit, and the guardian dies silently with its supervisor.
    pub fn faults(&self) -> usize {
        processes_of(&self.injection)
    }

    /// The same of the fault beside it.
    pub fn faults_beside(&self) -> usize {
        self.with.as_ref().map_or(0, processes_of)
    }

    /// Whether it is for the process that the swap brings.
    pub fn is_of_newcomer(&self) -> bool {
        is_of_newcomer(&self.injection.target)
    }

    /// Whether it is asked of a spare that makes no steps, where nothing else is under way, and comes about in steps alone.
    pub fn is_of_idle_spare(&self) -> bool {
        let target = Target::parse(&self.injection.target);
        let is_idle = target.is_some_and(|target| target.which == Which::Spare && target.role.is_stateful());
        is_idle && self.injection.is_of_steps() && !matches!(self.state, State::Recovery | State::Swap | State::Handover)
    }

    /// Whether it leaves damage in what is shared that a process may read long after, when another fault has come: its stations have no other faults.
    pub fn leaves_damage(&self) -> bool {
        self.injection.place.is_some_and(|place| place != Place::Checkpoint)
    }

    /// The target's role.
    pub fn role(&self) -> &str {
        Role::name_in(&self.injection.target)
    }

    /// Whether it can be in an arm: the processes it hurts exist there, and the hand does something. Whether that cuts is the scene's to say.
    pub fn check_in(&self, arm: &Arm, campaign: &Campaign) -> Result<(), String> {
        let hand = campaign.hand();
        if self.state == State::Contact && (hand == "idle" || hand == "script:idle") {
            return Err(format!("state contact: the hand {hand:?} never touches; take script:press"));
        }
        let workers = campaign.station.workers.unwrap_or(Settings::default().workers);
        if workers > MAX_WORKERS {
            return Err(format!("workers = {workers}: at most {MAX_WORKERS}"));
        }
        let needs_recorder = self.swap == Some(Role::Recorder) || self.injection.kind == FaultKind::DiskFull;
        if needs_recorder && !campaign.records() {
            return Err("these stations have no recorder; take out [station] record = false".into());
        }
        let record = campaign.records().then(|| "x".into());
        let set = campaign.set(arm);
        let spares = set.get("spares").is_none_or(|value| value != "off");
        let slots = plan::slots(&Settings { workers, record, set, ..Settings::default() }, spares, None);
        for injection in [Some(&self.injection), self.with.as_ref()].into_iter().flatten() {
            injection.check_in(&slots).map_err(|reason| format!("arm {:?}: {reason}", arm.name))?;
        }
        match self.swap.and_then(|role| no_swap_among(&slots, role)) {
            Some(reason) => Err(format!("arm {:?}: swap: {reason}", arm.name)),
            None => Ok(()),
        }
    }
}

/// Why stations of these slots refuse every swap of a role; `None` if they do not.
fn no_swap_among(slots: &[Slot], role: Role) -> Option<String> {
    let name = role.name();
    match (slots.iter().filter(|slot| slot.role() == role).count(), role) {
        (0, _) => Some(format!("these stations have no {name}; take another role, or start them with one")),
        (1, Role::Haptic) => {
            Some(format!("{name} is swapped beside another one, and these stations have one; take out spares = \"off\""))
        }
        _ => None,
    }
}

/// Processes that a fault is for.
fn processes_of(injection: &Injection) -> usize {
    if injection.target.ends_with(":both") { 2 } else { 1 }
}
