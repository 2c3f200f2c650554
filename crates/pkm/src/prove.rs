//! `pkm prove`: blind trials. Cases are made and sealed, each is diagnosed by a process of its own, seals are opened, verdicts scored.

mod folder;
mod real;
mod trial;

use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;

use anyhow::{anyhow, ensure};
use pkm_trials::case::{Answer, Design, Level, MORE, ROBOTS, Wish, make};
use pkm_trials::menu::INSIDE;
use pkm_trials::score::{Marks, beside, judge, markdown, page};
use pkm_trials::seal;

use crate::out;
use crate::progress::Progress;
use folder::Folder;

/// Arguments of `pkm prove`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The plants, laws and random numbers of the trials are their own; the diagnosis sees the public files of a case and nothing else. What \
docs/PROOF.md says of the format lets you put in cases of your own: cases/NAME/ with case.toml, answers/NAME.json, seals.txt.

A run can be stopped with Ctrl-C at any time: what is complete stays, the diagnoses that are running are forgotten, --resume goes on. \
--seal-only and a later run without --cases keep the making and the diagnosing apart: hand over cases/ and seals.txt first, the answers \
later. --score-only opens the seals and counts what has been diagnosed so far, and what other methods said (`cargo xtask prove-baselines`).

--real diagnoses recordings of real robots in place of cases: friction and effects are taken out of their files, and what others have \
published must be named. The folder with the recordings is given by --data or by the environment variable PKM_DATA.

Exit status: 0 all was scored, 1 a seal is broken, 2 bad usage or bad input, 130 stopped by a signal.

Examples:
  pkm prove --cases 40 --seed 1 --out proof
  pkm prove --cases 1200 --seed 7 --out proof --jobs 4 --resume
  pkm prove --cases 80 --noise-factors 1,2,4,8 --level L2 --size 2 --out noise
  pkm prove --cases 60 --recordings 1,2,4 --level L2 --size 2 --out lengths
  pkm prove --cases 20 --effect backlash --level L1 --size 4 --out play
  pkm prove --cases 40 --seed 1 --out proof --seal-only
  pkm prove --out proof
  pkm prove --out proof --score-only
  pkm prove --real --data recordings --out real")]
pub(crate) struct Args {
    /// Number of cases to make; without it, those that lie in the folder are used.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000), help_heading = "Cases")]
    cases: Option<u64>,
    /// Seed of all cases.
    #[arg(long, value_name = "S", default_value_t = 1, help_heading = "Cases")]
    seed: u64,
    /// Folder for cases, answers, seals, verdicts and scores.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Diagnoses at a time.
    #[arg(long, value_name = "J", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    jobs: u16,
    /// Only this level of concealment, L0 to L7; may be given several times [default: all].
    #[arg(long = "level", value_name = "L", value_parser = level, help_heading = "Cases")]
    levels: Vec<Level>,
    /// Only this robot; may be given several times [default: five of the shipped ones].
    #[arg(long = "robot", value_name = "NAME", value_parser = robot, help_heading = "Cases")]
    robots: Vec<String>,
    /// Size of an effect over the smallest that can be detected; may be given several times [default: 0.5 1 2 4].
    #[arg(long = "size", value_name = "X", value_parser = crate::diagnosis::positive, help_heading = "Cases")]
    sizes: Vec<f64>,
    /// Only this effect of the catalogue; may be given several times [default: all that are concealed].
    #[arg(long = "effect", value_name = "NAME", value_parser = effect, help_heading = "Cases")]
    effects: Vec<String>,
    /// Factors on the noise of the sensors, drawn at random for every case; sizes stay those of factor 1 [default: 1].
    #[arg(long, value_name = "F,F...", value_delimiter = ',', value_parser = crate::diagnosis::positive, help_heading = "Cases")]
    noise_factors: Vec<f64>,
    /// How many recordings there are to learn from, drawn at random for every case: 1 to 4; sizes stay those of 2 [default: 2].
    #[arg(long, value_name = "N,N...", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(1..=4), help_heading = "Cases")]
    recordings: Vec<u16>,
    /// Make and seal the cases, then stop.
    #[arg(long, conflicts_with = "score_only", help_heading = "Steps")]
    seal_only: bool,
    /// Open the seals and score the verdicts that are there.
    #[arg(long, conflicts_with = "cases", help_heading = "Steps")]
    score_only: bool,
    /// Diagnose real recordings whose missing physics is known.
    #[arg(long, conflicts_with_all = ["cases", "seal_only", "score_only", "resume"], help_heading = "Steps")]
    real: bool,
    /// Folder with the real recordings [default: the environment variable `PKM_DATA`].
    #[arg(long, value_name = "DIR", requires = "real", help_heading = "Steps")]
    data: Option<PathBuf>,
    /// Go on with a run that was stopped: what is there is kept.
    #[arg(long, help_heading = "Steps")]
    resume: bool,
    /// Stop a diagnosis after this time.
    #[arg(long, value_name = "SECONDS", default_value_t = 900.0, value_parser = crate::diagnosis::positive)]
    timeout: f64,
    /// Print the scores as JSON, what results.json holds.
    #[arg(long, conflicts_with = "seal_only")]
    json: bool,
    /// Print nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

fn level(text: &str) -> Result<Level, String> {
    let found = Level::ALL.into_iter().find(|l| format!("{l:?}").eq_ignore_ascii_case(text));
    found.ok_or_else(|| "must be L0, L1 … L7".to_string())
}

fn robot(text: &str) -> Result<String, String> {
    let known = ROBOTS.iter().chain(&MORE);
    known
        .clone()
        .find(|r| **r == text)
        .map(|r| (*r).to_string())
        .ok_or_else(|| format!("must be one of {}", known.copied().collect::<Vec<_>>().join(", ")))
}

fn effect(text: &str) -> Result<String, String> {
    let found = INSIDE.iter().find(|e| **e == text).map(|e| (*e).to_string());
    found.ok_or_else(|| format!("must be one of {}", INSIDE.join(", ")))
}

/// Exit code after SIGINT, as shells give it.
const STOPPED: u8 = 130;

/// Whether somebody wants the run to end; what is complete by then stays.
fn stopping() -> anyhow::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = Folder::new(&args.out);
    let stop = stopping()?;
    let stopped = || -> anyhow::Result<Option<ExitCode>> {
        if stop.load(Ordering::SeqCst) {
            out::error(&format!("stopped; `pkm prove --out {} --resume` with the same arguments goes on", args.out.display()));
            return Ok(Some(ExitCode::from(STOPPED)));
        }
        Ok(None)
    };
    if args.real {
        let data = args.data.clone().or_else(|| std::env::var_os("PKM_DATA").map(PathBuf::from));
        let data = data.ok_or_else(|| anyhow!("--real needs --data DIR, or the environment variable PKM_DATA"))?;
        let is_done = real::run(&data, &args.out, (args.timeout, &stop), args.quiet)?;
        return Ok(if is_done { ExitCode::SUCCESS } else { ExitCode::from(STOPPED) });
    }
    if !args.score_only {
        if let Some(count) = args.cases {
            ensure!(args.resume || !folder.has_seals(), "{}: holds a run already; --resume goes on with it", args.out.display());
            generate(args, &folder, count, &stop)?;
            if let Some(code) = stopped()? {
                return Ok(code);
            }
        }
        let names = folder.names()?;
        let seals = folder.seals()?;
        if !args.quiet && !args.json {
            out::say(seal::list(&seals).trim_end())?;
        }
        if !args.json {
            out::say(&format!("sealed {} answers; SHA-256 of the list {}", seals.len(), seal::sha256(seal::list(&seals))))?;
        }
        if args.seal_only {
            return Ok(ExitCode::SUCCESS);
        }
        diagnose(args, &folder, &names, &stop)?;
        if let Some(code) = stopped()? {
            return Ok(code);
        }
    }
    score(args, &folder)
}

/// Makes what is not there yet, several cases at a time; seals are written when every case is there.
fn generate(args: &Args, folder: &Folder, count: u64, stop: &AtomicBool) -> anyhow::Result<()> {
    let design = Design {
        levels: args.levels.clone(),
        robots: args.robots.clone(),
        sizes: args.sizes.clone(),
        noise_factors: args.noise_factors.clone(),
        recordings: args.recordings.iter().map(|n| usize::from(*n)).collect(),
        effects: args.effects.clone(),
    };
    let numbers: Vec<u64> = (1..=count).filter(|n| !(args.resume && folder.has_case(&Folder::name(*n)))).collect();
    let made = |n: u64| make(&Wish::of(n, args.seed, &design)).map_err(|e| anyhow!("case {n}: {e}"));
    // What a robot cannot have is told before anything is written.
    let first = numbers.first().filter(|_| !args.effects.is_empty()).map(|&n| made(n).map(|case| (n, case))).transpose()?;
    folder.create()?;
    if let Some((n, case)) = &first {
        folder.write_case(&Folder::name(*n), case)?;
    }
    each("making", args, stop, &numbers[usize::from(first.is_some())..], |n| folder.write_case(&Folder::name(*n), &made(*n)?))?;
    if stop.load(Ordering::SeqCst) { Ok(()) } else { folder.write_seals() }
}

fn diagnose(args: &Args, folder: &Folder, names: &[String], stop: &AtomicBool) -> anyhow::Result<()> {
    let left: Vec<String> = names.iter().filter(|n| !folder.has_run(n)).cloned().collect();
    if left.is_empty() {
        return Ok(());
    }
    let engine = trial::Engine::this()?;
    each("diagnosing", args, stop, &left, |name| match trial::diagnose(folder, name, &engine, (args.timeout, stop))? {
        Some(ran) => folder.write_run(name, &ran),
        None => Ok(()),
    })
}

/// Does `work` for every item in `args.jobs` threads; the first error ends it, and so does `stop`.
fn each<T: Sync>(
    label: &'static str,
    args: &Args,
    stop: &AtomicBool,
    items: &[T],
    work: impl Fn(&T) -> anyhow::Result<()> + Sync,
) -> anyhow::Result<()> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let progress = Mutex::new(Progress::new(label, args.quiet));
    let error = Mutex::new(None);
    std::thread::scope(|scope| {
        for _ in 0..args.jobs {
            scope.spawn(|| {
                while let Some(item) = items.get(next.fetch_add(1, Ordering::SeqCst)).filter(|_| !stop.load(Ordering::SeqCst)) {
                    if let Err(e) = work(item) {
                        // The others finish what they have begun and find nothing more.
                        next.store(items.len(), Ordering::SeqCst);
                        error.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(e);
                    }
                    let share = (done.fetch_add(1, Ordering::SeqCst) + 1) as f64 / items.len() as f64;
                    progress.lock().unwrap_or_else(std::sync::PoisonError::into_inner).update(share);
                }
            });
        }
    });
    let error = error.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    error.map_or(Ok(()), Err)
}

fn score(args: &Args, folder: &Folder) -> anyhow::Result<ExitCode> {
    let seals = folder.seals()?;
    let mut answers = Vec::new();
    let mut broken = Vec::new();
    for (name, hash) in &seals {
        let text = folder.answer(name)?;
        if seal::sha256(&text) == *hash {
            let answer: Answer = serde_json::from_str(&text).map_err(|e| anyhow!("answers/{name}.json: {e}"))?;
            answers.push((name.as_str(), answer));
        } else {
            broken.push(name.clone());
        }
    }
    let marks = marks(folder, &answers, &mut broken)?;
    if !broken.is_empty() {
        out::error(&format!("changed after they had been sealed: {}", broken.join(", ")));
        return Ok(ExitCode::from(1));
    }
    ensure!(!marks.is_empty(), "{}: nothing has been diagnosed yet", args.out.display());
    let mut table = markdown(&marks);
    let mut others = Vec::new();
    for (name, other) in folder.others()? {
        others.push((name, self::marks(&other, &answers, &mut broken)?));
    }
    if !others.is_empty() {
        table += &beside(&marks, &others);
    }
    let title = format!("Blind trials: {} of {} cases, scored by pkm {}", marks.len(), seals.len(), crate::VERSION);
    let results = folder.write_scores(&marks, &table, &page(&title, &marks, &table))?;
    if args.json {
        out::say(&out::clean(results.trim_end()))?;
    } else if !args.quiet {
        out::say(&out::clean(table.trim_end()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Marks of what a folder says of the cases; verdicts that changed since they were noted go to `broken`.
fn marks(folder: &Folder, answers: &[(&str, Answer)], broken: &mut Vec<String>) -> anyhow::Result<Vec<Marks>> {
    let mut out = Vec::new();
    for (name, answer) in answers {
        let Some(ran) = folder.run(name)? else { continue };
        if folder.is_verdict_changed(name, &ran)? {
            broken.push(format!("{name} (verdict)"));
            continue;
        }
        out.push(judge(name, answer, folder.verdict(name)?.as_ref(), &ran));
    }
    Ok(out)
}
