//! A reader of OpenMetrics 1.0 that is as strict as the standard: a monitor may refuse the whole text for one line. It knows gauges and counters, and takes
//! nothing in the value of a label that would have to be escaped.

use super::text;
use crate::look::{Look, Pictures, Process, Recording, Status, Tissue};
use crate::pump::Pump;
use std::collections::{BTreeMap, BTreeSet};

/// Ends of names that are kept for samples.
const RESERVED: [&str; 8] = ["_total", "_created", "_info", "_bucket", "_count", "_sum", "_gcount", "_gsum"];

/// What is told of one family.
#[derive(Debug, Default)]
struct Told<'a> {
    help: &'a str,
    kind: &'a str,
    unit: &'a str,
    /// By name and labels.
    samples: BTreeMap<&'a str, f64>,
}

/// Whether a name may be one of a metric, or of a label.
fn is_name(name: &str) -> bool {
    let is_letter = |byte: u8| byte.is_ascii_alphabetic() || byte == b'_';
    name.bytes().next().is_some_and(is_letter) && name.bytes().all(|byte| is_letter(byte) || byte.is_ascii_digit())
}

/// Whether what stands between braces are labels, none of them twice.
fn are_labels(labels: &str) -> bool {
    let mut keys = BTreeSet::new();
    labels.split(',').all(|label| {
        let pair = label.split_once('=').and_then(|(key, value)| Some((key, value.strip_prefix('"')?.strip_suffix('"')?)));
        pair.is_some_and(|(key, value)| is_name(key) && !value.contains(['"', '\\']) && keys.insert(key))
    })
}

/// The families of a text, by their names; or what is wrong with it. They stand one after the other, and what is said of one before its samples.
fn read(text: &str) -> Result<BTreeMap<&str, Told<'_>>, String> {
    let body = text.strip_suffix("# EOF\n").ok_or("it does not end with # EOF")?;
    let mut families: BTreeMap<&str, Told<'_>> = BTreeMap::new();
    let mut present = "";
    for line in body.lines() {
        let refused = |why: &str| format!("{why}: {line}");
        if let Some(said) = line.strip_prefix("# ") {
            let mut words = said.splitn(3, ' ');
            let (Some(what), Some(name), Some(told)) = (words.next(), words.next(), words.next()) else {
                return Err(refused("nothing is said"));
            };
            if name != present
                && (families.contains_key(name) || !is_name(name) || RESERVED.iter().any(|end| name.ends_with(end)))
            {
                return Err(refused("no name of another family"));
            }
            present = name;
            let family = families.entry(name).or_default();
            let place = match what {
                "HELP" => &mut family.help,
                "TYPE" => &mut family.kind,
                "UNIT" => &mut family.unit,
                _ => return Err(refused("neither help nor type nor unit")),
            };
            if !family.samples.is_empty() || !place.is_empty() || told.contains(['"', '\\']) {
                return Err(refused("said twice, too late, or to be escaped"));
            }
            *place = told;
            continue;
        }
        let family = families.get_mut(present).ok_or_else(|| refused("of no family"))?;
        let (front, value) = line.rsplit_once(' ').ok_or_else(|| refused("without a value"))?;
        let (name, labels) = front.split_once('{').map_or((front, None), |(name, labels)| (name, Some(labels)));
        let value: f64 = value.parse().map_err(|_| refused("no number"))?;
        let is_sample = match family.kind {
            "gauge" => name == present,
            "counter" => name.strip_suffix("_total") == Some(present) && value.is_finite() && value >= 0.0,
            _ => false,
        };
        let is_labelled = labels.is_none_or(|labels| labels.strip_suffix('}').is_some_and(are_labels));
        if !is_sample || !is_labelled || family.samples.insert(front, value).is_some() {
            return Err(refused("no sample of its family, or one that was there"));
        }
    }
    let is_whole = |(name, told): (&&str, &Told<'_>)| {
        let front = name.strip_suffix(told.unit);
        !told.samples.is_empty() && (told.unit.is_empty() || front.is_some_and(|front| front.ends_with('_')))
    };
    let all_are_whole = families.iter().all(is_whole);
    all_are_whole
        .then_some(families)
        .ok_or_else(|| "a family without samples, or whose name does not end with its unit".to_string())
}

/// A station of which everything is known, with figures that are as large and as small as they can be.
fn everything() -> Look {
    let process = |name: &str| Process {
        name: name.into(),
        state: "spare".into(),
        incarnation: u32::MAX,
        restarts: u64::MAX,
        rate_hz: Some(1e-9),
        recent_wakeup_p99_us: Some(134_218.0),
        recent_loop_p99_us: Some(0.0),
        age_ms: Some(1e12),
        ..Process::default()
    };
    let recording = Recording {
        file: "/a \"b\"\n.mcap".into(),
        lost: u64::MAX,
        stands_still: Some("no \"room\"".into()),
        free_bytes: Some(1 << 60),
        lasts_s: Some(4.5),
        ..Recording::default()
    };
    let status = Status {
        station: "a \"b\"\n".into(),
        tick: u64::MAX,
        processes: ["haptic:0", "haptic:1", "supervisor"].map(process).into(),
        recording: Some(recording),
        ..Status::default()
    };
    let alarms = vec!["deficit".into(), "unknown (0x40)".into()];
    let pump = Pump { deficit_ml: -1e-300, cavity_ml: 1e300, transmittance: Some(0.25), alarms, ..Pump::default() };
    let pictures = Pictures { count: u64::MAX, period_s: 0.04, passes_s: [1e-6; 5], ..Pictures::default() };
    let tissue = Tissue { cut_limits: u32::MAX, ..Tissue::default() };
    Look { status, pump: Some(pump), tissue: Some(tissue), pictures: Some(pictures), ..Look::default() }
}

#[test]
fn whatever_is_known_of_a_station_the_text_is_openmetrics() {
    let unasked = Look { silence: Some("the supervisor was not asked yet".into()), ..Look::default() };
    let texts = [everything(), Look::default(), unasked].map(|look| text(&look));
    let [all, fresh, nothing] = texts.each_ref().map(|text| read(text).unwrap_or_else(|why| panic!("{why}\n{text}")));
    assert!(fresh.keys().chain(nothing.keys()).all(|name| all.contains_key(name)));
    assert!((1..fresh.len()).contains(&nothing.len()) && fresh.len() < all.len());
    for (name, told) in &all {
        assert!(name.starts_with("hystation_") && told.help.ends_with('.') && !told.help.ends_with(".."), "{name}: {told:?}");
    }
    let counters: Vec<&str> = all.iter().filter(|(_, told)| told.kind == "counter").map(|(name, _)| *name).collect();
    let of_tissue = ["corrections", "cut_limits", "hits_dropped"].map(|name| format!("hystation_tissue_{name}"));
    let [restarts, pictures] = ["hystation_process_restarts", "hystation_rendering_pictures"].map(str::to_string);
    assert_eq!(counters, [vec![restarts, pictures], of_tissue.to_vec()].concat());
    assert_eq!(all["hystation_process_restarts"].samples.len(), 3);
    assert_eq!(all["hystation_pump_alarm"].samples.len(), hyst_messages::PUMP_ALARMS.len());
}

#[test]
fn a_text_that_a_monitor_may_refuse_is_refused() {
    let good = "# HELP a_seconds It.\n# TYPE a_seconds gauge\n# UNIT a_seconds seconds\na_seconds{p=\"x y\"} 1.0\n\
                # TYPE b counter\nb_total 2\n# EOF\n";
    assert_eq!(read(good).map(|families| families.len()), Ok(2));
    for (from, to) in [
        ("# EOF\n", ""),
        ("# EOF\n", "# EOF\n# EOF\n"),
        ("a_seconds{", "c_seconds{"),
        ("gauge", "counter"),
        ("gauge", "speed"),
        ("seconds seconds", "seconds hertz"),
        ("\"x y\"", "x"),
        ("p=", "0="),
        ("p=\"x y\"", "p=\"x\",p=\"y\""),
        ("1.0", "fast"),
        ("2\n", "-2\n"),
        ("b_total", "b"),
        ("b_total 2\n", ""),
        ("# TYPE a_seconds gauge\n", ""),
        ("1.0\n", "1.0\na_seconds{p=\"x y\"} 2.0\n"),
        ("1.0\n", "1.0\n# HELP a_seconds Again.\n"),
        ("b_total 2\n", "b_total 2\na_seconds 1.0\n"),
        ("b_total 2\n", "b_total 2\n# HELP a_seconds Again.\n"),
        ("a_seconds", "a_count"),
    ] {
        let bad = good.replace(from, to);
        assert!(bad != good && read(&bad).is_err(), "{bad}");
    }
}
