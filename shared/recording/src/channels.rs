//! The channels of a recording: topic and id of each, and the time of its messages.

use hyst_messages::TICK_NS;

/// A channel. The discriminant is its id, and its schema's, in every recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u16)]
pub enum Channel {
    /// Pose and velocity of the scope, each tick. A Foxglove PoseInFrame with more fields.
    Tool = 1,
    /// Force handed to the hardware, each tick.
    Force = 2,
    /// Buttons and valves: on change, and once in each block.
    Controls = 3,
    /// What happened to processes and data. A Foxglove Log with more fields.
    Events = 4,
    /// Status of the tissue, as often as the recorder looks.
    Tissue = 5,
    /// Status of the fluid, as often as the recorder looks.
    Fluid = 6,
    /// What the tick's input says of the medium, and whom the device follows: on change, once in each block, and where a servo or a device did not go on from
    /// the tick before. What each servo went on from then.
    Input = 7,
    /// Every step of the tissue: what it was made from, and the hash of what came of it.
    Steps = 8,
    /// The whole state of tissue and fluid, every five seconds: what a replay begins with that does not begin at the beginning.
    Checkpoints = 9,
    /// What each process did in the last second.
    Processes = 10,
    /// What was seen when something happened. A Foxglove CompressedImage with more fields.
    Pictures = 11,
    /// The files of the scene, once.
    Scene = 12,
    /// What a referee had judged of the session's case when checkpoints were kept.
    Judged = 13,
}

impl Channel {
    /// All channels in the order of their ids.
    pub const ALL: [Channel; 13] = [
        Channel::Tool,
        Channel::Force,
        Channel::Controls,
        Channel::Events,
        Channel::Tissue,
        Channel::Fluid,
        Channel::Input,
        Channel::Steps,
        Channel::Checkpoints,
        Channel::Processes,
        Channel::Pictures,
        Channel::Scene,
        Channel::Judged,
    ];

    /// The topic.
    pub const fn topic(self) -> &'static str {
        match self {
            Channel::Tool => "/tool",
            Channel::Force => "/force",
            Channel::Controls => "/controls",
            Channel::Events => "/events",
            Channel::Tissue => "/tissue",
            Channel::Fluid => "/fluid",
            Channel::Input => "/input",
            Channel::Steps => "/steps",
            Channel::Checkpoints => "/checkpoints",
            Channel::Processes => "/processes",
            Channel::Pictures => "/pictures",
            Channel::Scene => "/scene",
            Channel::Judged => "/judged",
        }
    }

    /// Name of the schema; the three that Foxglove knows bear its names.
    pub const fn schema_name(self) -> &'static str {
        match self {
            Channel::Tool => "foxglove.PoseInFrame",
            Channel::Force => "hyst.Force",
            Channel::Controls => "hyst.Controls",
            Channel::Events => "foxglove.Log",
            Channel::Tissue => "hyst.Tissue",
            Channel::Fluid => "hyst.Fluid",
            Channel::Input => "hyst.Input",
            Channel::Steps => "hyst.Step",
            Channel::Checkpoints => "hyst.Checkpoint",
            Channel::Processes => "hyst.Process",
            Channel::Pictures => "foxglove.CompressedImage",
            Channel::Scene => "hyst.SceneFile",
            Channel::Judged => "hyst.Judged",
        }
    }

    /// The channel with this id.
    pub fn from_id(id: u16) -> Option<Channel> {
        Channel::ALL.into_iter().find(|channel| *channel as u16 == id)
    }
}

/// Station time of a tick, ns.
pub fn time_of_ns(tick: u64) -> u64 {
    tick.saturating_mul(TICK_NS)
}
