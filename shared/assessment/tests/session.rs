//! Promises of the report: values as by hand, the same bytes every time, what is missing is said, and no input panics.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{assessed, busy, bytes, bytes_of, event, eventful, fluid, of_blocks, outputs, record, square, tissue};
use hyst_assessment::{Assessment, Sessions, scores};
use hyst_messages::{Applied, AppliedRecord, BUTTON_ENERGIZED, TissueStatus};
use hyst_recording::{Block, Level, Reader, TickRange};
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;

fn value(assessment: &Assessment, key: &str) -> Option<f64> {
    let scores = scores(&assessment.measured);
    scores.metrics.iter().find(|metric| metric.definition.key == key).unwrap_or_else(|| panic!("no {key}")).value
}

fn is_near(assessment: &Assessment, key: &str, exact: f64) -> bool {
    value(assessment, key).is_some_and(|value| (value - exact).abs() <= 1e-6 * exact.abs().max(1.0))
}

#[test]
fn a_square_has_its_length_its_time_and_no_score_for_what_is_not_recorded() {
    let assessment = of_blocks("square", &[Block { applied: square(1_000), ..Block::default() }]);
    assert!(is_near(&assessment, "path", 0.04) && is_near(&assessment, "time", 0.041));
    assert!(is_near(&assessment, "economy", 100.0 * 2f64.sqrt() / 4.0));
    let of_medium = ["distended", "pressure_low", "deficit", "inflow", "bled", "bleeding"];
    let of_view = ["clear_view", "view_lost", "transmittance"];
    let of_loop = ["cuts", "removed", "healthy_removed", "energised_free"];
    for key in of_medium.into_iter().chain(of_view).chain(of_loop) {
        assert_eq!(value(&assessment, key), None, "{key}");
    }
    let scores = scores(&assessment.measured);
    assert_eq!((scores.groups[3], assessment.missing()), (None, Vec::<String>::new()));
}

#[test]
fn a_gap_a_lost_range_and_a_step_of_the_force_are_counted() {
    let mut applied: Vec<_> = (10..20).map(|tick| record(tick, [0.0; 3], 0.0)).collect();
    applied.extend((30..40).map(|tick| record(tick, [0.0; 3], if tick < 35 { 0.0 } else { 1.25 })));
    applied[12].command.kind = Applied::Held as u32;
    let lost = vec![TickRange { first: 20, last: 23 }];
    let assessment = of_blocks("gap", &[Block { applied, lost, ..Block::default() }]);
    let conduct = &assessment.measured.conduct;
    assert_eq!((conduct.ticks, conduct.missing, conduct.gaps, conduct.lost), (20, 10, 1, 4));
    assert_eq!(conduct.kinds, [19, 1, 0, 0, 0]);
    assert_eq!(conduct.largest_step.map(|step| (step.value, step.tick)), Some((1.25, 35)));
    assert!(
        is_near(&assessment, "time", 0.030) && is_near(&assessment, "force_peak", 1.25) && is_near(&assessment, "touching", 25.0)
    );
    assert!(assessment.missing()[0].contains("lost 4 ticks"), "{:?}", assessment.missing());
}

#[test]
fn a_pose_that_is_no_number_costs_nothing_but_itself() {
    let mut applied = square(1);
    applied[20].sample.pose.position_m[1] = f32::NAN;
    applied[21].command.force_n[0] = f32::INFINITY;
    let assessment = of_blocks("nan", &[Block { applied, ..Block::default() }]);
    // Tick 21 is a corner: the way goes straight from (10, 9) to (9, 10) mm.
    assert!(is_near(&assessment, "path", 0.038 + 2f64.sqrt() * 1e-3), "{:?}", value(&assessment, "path"));
    assert_eq!((assessment.measured.conduct.not_finite, assessment.measured.force.ticks), (2, 40));
}

/// The medium, which the scope meets where there is no wall, was one that was touched, and current in it was current at work.
#[test]
fn what_the_medium_does_to_the_scope_is_no_touch() {
    let told = |tick: u64| {
        // As a servo makes it of the medium; with a wall beside it; a wall alone; what a device lets go of.
        let (medium_n, force_n) = [(0.2, 0.198), (0.2, 0.198), (0.2, 0.3), (0.0, 0.2), (0.2, 0.0)][tick as usize / 200];
        let mut record = AppliedRecord { on_scope_n: [0.0, 0.0, medium_n], ..record(tick, [0.0; 3], force_n) };
        record.sample.controls.buttons = BUTTON_ENERGIZED;
        record
    };
    let assessment = of_blocks("touch", &[Block { applied: (0..1_000).map(told).collect(), ..Block::default() }]);
    assert!(is_near(&assessment, "touching", 40.0), "{:?}", value(&assessment, "touching"));
    assert!(is_near(&assessment, "energised_free", 60.0), "{:?}", value(&assessment, "energised_free"));
}

#[test]
fn the_medium_and_the_cuts_are_those_of_the_statuses() {
    let block = |first: u64| Block {
        applied: (first..first + 1_000).map(|tick| record(tick, [0.0; 3], 0.0)).collect(),
        fluid: vec![fluid(first, if first == 0 { 20.0 } else { 70.0 }, 0.5 * first as f64 * 1e-3)],
        tissue: vec![TissueStatus { washed_out_ml: 0.25, taken_out_ml: 0.5, ..tissue(first, (first / 1_000) as u32, 0.1) }],
        ..Block::default()
    };
    let blocks: Vec<Block> = (0..21).map(|second| block(1_000 * second)).collect();
    let assessment = of_blocks("medium", &blocks);
    // 1 s of 20 mmHg, 19 s of 70, in the mean 45 and more; the last status has no time. 0.5 ml/s are 30 ml/min; 60 ml/min for 20 s are 20 ml.
    for (key, exact) in [
        ("pressure_low", 5.0),
        ("pressure_high", 0.0),
        ("distended", 95.0),
        ("deficit", 10.0),
        ("deficit_rate", 30.0),
        ("bled", 1.0),
        ("bleeding", 100.0), // 3 ml/min, as far as it is known
    ] {
        assert!(is_near(&assessment, key, exact), "{key}: {:?}", value(&assessment, key));
    }
    assert!(is_near(&assessment, "inflow", 20.0) && is_near(&assessment, "cuts", 20.0) && is_near(&assessment, "removed", 0.1));
    assert!(is_near(&assessment, "brought_out", 0.75), "through the outflow and in the jaws");
    assert!(value(&assessment, "pressure_peak").is_some_and(|mmhg| (mmhg - 70.0).abs() < 1e-3));
}

#[test]
fn the_same_recording_gives_the_same_bytes_however_many_threads_read_it() {
    let bytes = bytes("same", &eventful());
    let first = outputs(&bytes, 1);
    for threads in [1, 2, 3, 64] {
        assert!(outputs(&bytes, threads) == first, "{threads} threads");
    }
}

#[test]
fn the_text_fits_100_columns_and_names_faults_and_takeovers() {
    let (assessment, _) = assessed(&bytes("text", &eventful()), 2);
    let mut sessions = Sessions::new("session.mcap", assessment.clone());
    for compared in 0..4 {
        let text = hyst_assessment::text(&sessions);
        let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 100, "{widest} columns, {compared} compared:\n{text}");
        assert!(text.contains("tissue:0 <died>") && text.contains("takeover") && text.contains("0.850 s"), "{text}");
        assert!(text.contains("tissue:0               999.0/s"), "{text}");
        assert!(text.contains("     1.300 s  a piece\n"), "{text}");
        assert_eq!(text.contains("weight"), compared == 0);
        sessions.compare("earlier.mcap", assessment.clone());
    }
}

#[test]
fn a_report_says_which_build_made_the_recording_on_which_machine_and_nothing_of_an_older_one() {
    let (cpu, kernel) = ("A <fast> CPU @ 2.00GHz", "6.1.0-44-amd64");
    let noted = [("version", "0.1.0"), ("build", "00ff00ff00ff00ff"), ("cpu", cpu), ("cores", "2"), ("kernel", kernel)];
    let [text, page, json, _] = outputs(&bytes_of("build", &[&[("session", "s")][..], &noted].concat(), &eventful()), 1);
    for line in [
        "station's version   0.1.0, build 00ff00ff00ff00ff\n",
        "processor           A <fast> CPU @ 2.00GHz, 2 cores\n",
        "kernel              Linux 6.1.0-44-amd64\n",
    ] {
        assert!(text.contains(line), "{line}{text}");
    }
    assert!(page.contains("<dd>A &lt;fast&gt; CPU @ 2.00GHz, 2 cores</dd>") && page.contains("build 00ff00ff00ff00ff"));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert!(noted.iter().all(|(name, value)| json["session"][name] == *value), "{}", json["session"]);
    let [text, ..] = outputs(&bytes("older", &eventful()), 1);
    assert!(text.contains("station's version   0.1.0\n") && !text.contains("processor "), "{text}");
}

#[test]
fn the_page_needs_nothing_beside_it_and_text_from_the_recording_stays_text() {
    let [_, page, json, csv] = outputs(&bytes("page", &eventful()), 1);
    for foreign in ["<script", "http:", "https:", "url(", "@import", "<link", "script:<polyp>", "tissue:0 <died>"] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    assert!(page.contains("script:&lt;polyp&gt;") && page.contains("tissue:0 &lt;died&gt;"));
    assert!(page.contains("<td class=\"text\">&lt;b&gt;</td>") && page.contains("<td>999.0</td><td>2</td>"), "its processes");
    let picture = "<img alt=\"warning: &lt;loud&gt; &amp; &quot;near&quot;\" src=\"data:image/jpeg;base64,/9j/2Q==\">";
    assert!(page.contains(picture) && page.matches("<figure>").count() == 2 && page.contains("<b>1.3 s</b> a piece<"));
    for no_number in ["NaN", ">inf", "\"inf", "Linf", "Minf"] {
        assert!(!page.contains(no_number), "{no_number}");
    }
    for open in ["section", "table", "svg", "dl", "div", "ul"] {
        let count = |mark: String| page.matches(&mark).count();
        let opened = count(format!("<{open}>")) + count(format!("<{open} "));
        assert_eq!(opened, count(format!("</{open}>")), "{open}");
    }
    assert_eq!(page.matches("class=\"curve ").count(), 5);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((json["station"]["takeovers"].as_u64(), json["station"]["ticks"].as_u64()), (Some(1), Some(3_000)));
    let pictures = serde_json::json!([
        { "tick": 6_310, "event_tick": 6_210, "time_s": 1.21, "words": "warning: <loud> & \"near\"", "bytes": 4 },
        { "tick": 6_400, "event_tick": 6_300, "time_s": 1.3, "words": "a piece", "bytes": 4 },
    ]);
    assert_eq!(json["pictures"], pictures);
    let tissue = &json["station"]["processes"]["tissue:0"];
    assert_eq!((tissue["rate_hz"].as_f64(), tissue["overruns"].as_u64()), (Some(999.0), Some(2)));
    assert!(tissue["wakeup_p99_us_largest"].is_null() && tissue["loop_p99_us_largest"] == 900.0, "{tissue}");
    assert_eq!((json["is_whole"].as_bool(), json["compared"].as_array().map(Vec::len)), (Some(true), Some(1)));
    assert_eq!((csv.lines().count(), csv.lines().last().unwrap().split(',').next()), (31, Some("7999")));
}

/// For as long as both fluids were dead each row had the last pressure again, and nobody saw the hole.
#[test]
fn a_row_before_which_no_fluid_has_spoken_for_a_second_says_nothing_of_the_medium() {
    let block = |first: u64| Block {
        applied: (first..first + 1_000).map(|tick| record(tick, [0.0; 3], 0.0)).collect(),
        fluid: if (1_000..4_000).contains(&first) { Vec::new() } else { vec![fluid(first, 70.0, 1.0)] },
        tissue: vec![tissue(first, 1, 0.1)],
        ..Block::default()
    };
    let blocks: Vec<Block> = (0..5).map(|second| block(1_000 * second)).collect();
    let (_, csv) = assessed(&bytes("silent", &blocks), 1);
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let known = |name: &str| {
        let column = rows[0].iter().position(|head| *head == name).unwrap();
        (1..rows.len()).filter(|row| !rows[*row][column].is_empty()).collect::<Vec<_>>()
    };
    let spoken: Vec<usize> = (1..=10).chain(41..=50).collect();
    for name in ["pressure_pa", "deficit_ml", "inflow_ml_min", "alarms", "bled_ml"] {
        assert_eq!(known(name), spoken, "{name}");
    }
    assert_eq!(known("cuts").len(), 50, "what was cut stays cut");
}

/// Whoever is given the files of a class finds what stands in them.
#[test]
fn each_column_of_the_rows_and_each_key_of_the_json_stands_in_the_documents() {
    let [_, _, json, csv] = outputs(&bytes("documented", &eventful()), 1);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let columns = csv.lines().next().unwrap().split(',').map(str::to_string);
    let keys = json.as_object().unwrap().keys().cloned();
    let text = include_str!("../../../docs/sessions.md");
    let research = text.split("### For research").nth(1).and_then(|rest| rest.split("\n### ").next()).unwrap();
    let unknown: Vec<String> = columns.chain(keys).filter(|name| !research.contains(&format!("`{name}`"))).collect();
    assert_eq!(unknown, Vec::<String>::new());
}

#[test]
fn a_recording_that_is_cut_anywhere_is_reported_as_far_as_it_goes_and_says_so() {
    let whole = bytes("cut", &(0..6).map(|index| busy(5_000 + 20 * index, 20)).collect::<Vec<_>>());
    let (mut refused, mut empty, mut told) = (0, 0, 0);
    for length in (0..whole.len()).step_by(97) {
        let Ok(reader) = Reader::new(Cursor::new(&whole[..length]), Path::new("memory")) else {
            refused += 1;
            continue;
        };
        let assessment = hyst_assessment::assess(reader, 2, |_| {});
        assert!(assessment.missing().iter().any(|sentence| sentence.contains("without a summary")), "{length}");
        empty += usize::from(assessment.is_empty());
        told += usize::from(!assessment.is_empty());
        let outputs = outputs(&whole[..length], 1);
        assert!(outputs.iter().all(|text| !text.is_empty()));
        assert!(outputs[0].starts_with("Not everything of the recording is there"), "said before any value: {}", outputs[0]);
    }
    assert!(refused > 0 && empty > 0 && told > 10, "{refused} {empty} {told}");
}

#[test]
fn flipped_bytes_are_named_and_the_rest_is_told() {
    let mut bad = bytes("flip", &eventful());
    // Over more bytes than the indexes of a block have, whose entries nobody needs.
    let middle = bad.len() / 2;
    bad[middle..middle + 12_000].iter_mut().step_by(1_000).for_each(|byte| *byte ^= 0x40);
    let (assessment, _) = assessed(&bad, 2);
    assert!(!assessment.missing().is_empty() && assessment.measured.conduct.ticks >= 1_000, "{:?}", assessment.missing());
}

#[test]
fn a_recording_without_a_tick_is_empty() {
    let only_events = Block { events: vec![event(3, Level::Warning, "died", "fluid:0", 2)], ..Block::default() };
    for blocks in [vec![], vec![only_events]] {
        let assessment = of_blocks("empty", &blocks);
        assert!(assessment.is_empty() && assessment.missing().is_empty());
    }
}

/// A disk that fails after so many bytes.
struct Failing(Cursor<Vec<u8>>, u64);

impl Read for Failing {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if self.0.position() > self.1 { Err(std::io::Error::other("the disk is gone")) } else { self.0.read(buffer) }
    }
}

impl Seek for Failing {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.0.seek(to)
    }
}

#[test]
fn what_could_not_be_read_to_its_end_says_why() {
    let whole = bytes("failing", &eventful());
    let half = whole.len() as u64 / 2;
    let reader = Reader::new(Failing(Cursor::new(whole), half), Path::new("memory")).unwrap();
    let assessment = hyst_assessment::assess(reader, 2, |_| {});
    assert!(assessment.measured.conduct.ticks > 0 && assessment.missing()[0].contains("the disk is gone"));
}
