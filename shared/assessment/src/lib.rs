//! The report of a training session, computed from its recording alone: raw values with scores in the four groups of Bajka et al. 2010
//! (visualisation, ergonomics, safety, fluid handling), the judgement by the session's case, and what the station itself did. The same judgement, of a
//! session that runs, is [`Judge`].
//!
//! Promise: the same recording gives the same bytes, whatever the number of threads; memory does not grow with the recording's length; what the
//! recording does not hold is called absent and not invented; a raw value stands beside each score. Nothing in a recording causes a panic.

mod absent;
mod anatomy;
mod assess;
mod begin;
mod bleeding;
mod case;
mod clarity;
mod columns;
mod conduct;
mod curves;
mod electrode;
mod ended;
mod force;
mod in_view;
mod json;
mod judge;
mod kept;
mod losses;
mod markup;
mod medium;
mod metric;
mod motion;
mod page;
mod pieces;
mod plots;
mod processes;
mod row;
mod sight;
mod style;
mod table;
mod text;
mod way;

pub use absent::ABSENT;
pub use anatomy::Anatomy;
pub use assess::{Assessment, Measured, assess, judge_until};
pub use clarity::{CLEAR_SHARE, Clarity};
pub use columns::{Column, Sessions};
pub use conduct::{Conduct, Peak};
pub use curves::{Curves, Series, Trace};
pub use electrode::Electrode;
pub use ended::EndedBy;
pub use force::{Force, LIMIT_N, TOUCH_N};
pub use in_view::InView;
pub use json::json;
pub use judge::{GoalState, Judge, WarningState};
pub use markup::{escape, plain, wide_table};
pub use medium::{HIGH_PA, LOW_PA, Medium, PARTED_PA};
pub use metric::{Definition, Group, Metric, Scale, Scores, scores};
pub use motion::Motion;
pub use page::html;
pub use processes::{ProcessSum, Processes};
pub use row::{CSV_HEAD, Row};
pub use table::{METRICS, OF_THE_TASK};
pub use text::text;
