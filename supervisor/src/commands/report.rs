//! `hystation report`: reads recordings, writes what `hyst-assessment` makes of them. Nothing is written of a recording that cannot be reported.

use super::given::Given;
use super::watched::Watched;
use crate::cli::ReportArgs;
use crate::recorded::{Undrawn, anatomy};
use crate::settings::Refusal;
use hyst_assessment::{Anatomy, Assessment, CSV_HEAD, Row, Sessions, assess, html, json, text};
use hyst_recording::{ReadError, Reader, open_file};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Most threads that decode a recording ahead of the one that reads it and sums up: a station may be running beside, and more gain little.
const MOST_THREADS: usize = 4;
/// Most earlier sessions in one report: each is read from its beginning to its end.
const MOST_COMPARED: usize = 8;

/// Prints or writes the report; exit code 3 if something of a recording is missing, or a disk does not take what is written, 2 if there is nothing to report.
pub fn report(args: &ReportArgs) -> Result<u8, Refusal> {
    check(args)?;
    let reader = open(&args.file)?;
    let earlier = args.compare.iter().map(|path| open(path)).collect::<Result<Vec<_>, _>>()?;
    let mut csv = Csv { path: args.csv.clone(), out: None, refused: None };
    let mut assessment = read(&args.file, reader, |row| csv.row(row))?;
    csv.finish()?;
    let is_lost = args.html.is_some() && !draw(args, &mut assessment);
    let mut sessions = Sessions::new(&name(&args.file), assessment);
    for (path, reader) in args.compare.iter().zip(earlier) {
        sessions.compare(&name(path), read(path, reader, |_| {})?);
    }
    give(args, &sessions)?;
    let missing = sessions.missing();
    if let Some(first) = missing.first() {
        eprintln!(
            "hystation: not everything is there: {first}{}",
            if missing.len() > 1 { "; and more, see the report" } else { "" }
        );
    }
    Ok(if missing.is_empty() && !is_lost { 0 } else { 3 })
}

/// Puts the organ behind the path, or why there is none; false if it is there and the system did not let it be read.
fn draw(args: &ReportArgs, assessment: &mut Assessment) -> bool {
    let why = match anatomy(&args.file, &assessment.session) {
        Ok(scene) => {
            assessment.anatomy = Some(Anatomy::of(&scene));
            return true;
        }
        Err(why) => why,
    };
    assessment.undrawn = Some(why.to_string());
    let is_refused = matches!(why, Undrawn::Refused(..));
    if is_refused {
        eprintln!("hystation: the page has no organ behind the path: {why}");
    }
    !is_refused
}

fn name(path: &Path) -> String {
    path.display().to_string()
}

/// Where the page goes, if one is asked for: beside the recording, by its name, where no file is named.
fn page(args: &ReportArgs) -> Option<PathBuf> {
    let file = args.html.as_ref()?;
    Some(file.clone().unwrap_or_else(|| args.file.with_extension("html")))
}

fn outputs(args: &ReportArgs) -> impl Iterator<Item = (&'static str, PathBuf)> {
    let files = [("--html", page(args)), ("--json", args.json.clone()), ("--csv", args.csv.clone())];
    files.into_iter().filter_map(|(option, path)| Some((option, path?))).filter(|(_, path)| !is_stdout(path))
}

fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// Refuses what cannot be done, before anything is read.
fn check(args: &ReportArgs) -> Result<(), Refusal> {
    if args.compare.len() > MOST_COMPARED {
        return Err(Refusal::input(format!(
            "--compare: {} sessions, at most {MOST_COMPARED} fit beside each other",
            args.compare.len()
        )));
    }
    if page(args).as_deref().is_some_and(is_stdout) || args.csv.as_deref().is_some_and(is_stdout) {
        return Err(Refusal::input("--html -, --csv -: only --json goes to stdout; give a file"));
    }
    let mut taken: Vec<PathBuf> = std::iter::once(&args.file).chain(&args.compare).map(|path| whole(path)).collect();
    for (option, path) in outputs(args) {
        let refuse = |what: &str| Refusal::input(format!("{option} {}: {what}", path.display()));
        let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if !folder.is_dir() {
            return Err(refuse("its folder does not exist; make it first"));
        }
        if path.is_dir() {
            return Err(refuse("is a folder; give a file"));
        }
        let path = whole(&path);
        if taken.contains(&path) {
            return Err(refuse("is a recording, or is written by another option; give another file"));
        }
        taken.push(path);
    }
    Ok(())
}

/// The path by which a file is known, whether it exists or is going to.
fn whole(path: &Path) -> PathBuf {
    let through_folder = || {
        let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Some(folder.canonicalize().ok()?.join(path.file_name()?))
    };
    path.canonicalize().ok().or_else(through_folder).unwrap_or_else(|| path.to_path_buf())
}

/// Opens a recording, if it is one.
pub fn open(path: &Path) -> Result<Reader<Watched>, Refusal> {
    let refused = |error: ReadError| Refusal::input(error.to_string());
    let file = Watched::of(open_file(path).map_err(refused)?, path);
    let file = file.map_err(|source| refused(ReadError::File { path: path.to_owned(), source }))?;
    Reader::new(file, path).map_err(refused)
}

/// Threads that decode a recording.
pub fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, |threads| threads.get().min(MOST_THREADS))
}

fn read(path: &Path, reader: Reader<Watched>, row: impl FnMut(&Row)) -> Result<Assessment, Refusal> {
    let assessment = assess(reader, threads(), row);
    if assessment.is_empty() {
        let missing = assessment.missing();
        let why = missing.first().map_or("nothing was recorded", String::as_str);
        return Err(Refusal::input(format!(
            "recording {}: holds no tick of a session ({why}); give one that was recorded for longer",
            path.display()
        )));
    }
    Ok(assessment)
}

/// Writes what was asked for.
fn give(args: &ReportArgs, sessions: &Sessions) -> Result<(), Refusal> {
    if let Some(path) = page(args) {
        write(&path, &html(sessions))?;
    }
    let for_programs = || serde_json::to_string_pretty(&json(sessions)).map(|text| text + "\n");
    let for_programs = || for_programs().map_err(|error| Refusal::failed(error.to_string()));
    let shown = match args.json.as_deref() {
        Some(path) if is_stdout(path) => for_programs()?,
        Some(path) => {
            write(path, &for_programs()?)?;
            text(sessions)
        }
        None => text(sessions),
    };
    // A reader that has gone (`| head`) has read what it wanted.
    let _ = io::stdout().write_all(shown.as_bytes());
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<(), Refusal> {
    let written = Given::begin(path).and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.finish()));
    written.map_err(|error| unwritten(path, &error))
}

/// A file that is not there: nobody may write it in that place, or the disk has not taken it.
fn unwritten(path: &Path, error: &io::Error) -> Refusal {
    let refused = |cure: &str| format!("{}: {error}; {cure}", path.display());
    match error.kind() {
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem | ErrorKind::NotFound => {
            Refusal::input(refused("give a file in a folder that may be written"))
        }
        _ => Refusal::lost(refused("is the disk full? What was there before is there still")),
    }
}

/// The file of the time series, made when its first row comes.
struct Csv {
    path: Option<PathBuf>,
    out: Option<Given>,
    refused: Option<io::Error>,
}

impl Csv {
    fn row(&mut self, row: &Row) {
        if self.refused.is_none() {
            self.refused = self.write(row).err();
        }
    }

    fn write(&mut self, row: &Row) -> io::Result<()> {
        let Some(path) = &self.path else { return Ok(()) };
        let out = match &mut self.out {
            Some(out) => out,
            None => {
                let mut out = Given::begin(path)?;
                writeln!(out, "{CSV_HEAD}")?;
                self.out.insert(out)
            }
        };
        writeln!(out, "{}", row.csv())
    }

    fn finish(self) -> Result<(), Refusal> {
        let finish = || self.out.map_or(Ok(()), Given::finish).err();
        match (self.path, self.refused.or_else(finish)) {
            (Some(path), Some(error)) => Err(unwritten(&path, &error)),
            _ => Ok(()),
        }
    }
}
