//! `pkm workspace`: which poses a robot can reach, what limits it, and how near it is to a singularity.

mod arguments;
mod files;
mod plan;

use core::sync::atomic::{AtomicUsize, Ordering};
use core::time::Duration;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::thread;

use anyhow::anyhow;
use pkm_dyn::workspace::{Scan, Slice};
use pkm_report::Style;

use crate::outputs::Outputs;
use crate::progress::Progress;
use crate::{out, robot_file};
use arguments::{Cone, Range, Value};
use plan::Plan;

/// Arguments of `pkm workspace`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A slice has one or two scanned axes; every other coordinate stays at home or where --at puts it. Axes are coordinates of the link \
(x y z rx ry rz in the root frame, rotation Rx(rx)·Ry(ry)·Rz(rz)) or driven joints by name. Numbers are m and rad; `30deg` and `12mm` \
are understood. Poses are followed from home from cell to neighbouring cell, so all belong to one assembly of the loops.

Exit status: 0 the scan ran, 2 bad usage or a robot whose loops do not close.

Examples:
  pkm workspace ups3_rpu1 --axes ry,rz --html out.html
  pkm workspace ups3_rpu1 --range x=-0.2:0.2:41 z=0.55:0.85:31 --at ry=0.1 \\
      --slices rz=-30deg:10deg:5 --cone 38 --csv out.csv
  pkm workspace five_bar --axes shoulder_left,shoulder_right --json")]
pub(crate) struct Args {
    /// A robot.toml, or the name of a shipped robot.
    robot: PathBuf,
    /// Link, sensor or loop whose frame is the output; needed where none stands out.
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// One or two axes of a slice; where --range names them, it need not be said again.
    #[arg(long, value_name = "A,B", value_delimiter = ',', num_args = 1..)]
    axes: Vec<String>,
    /// Range and number of values of an axis; without it, somewhat more than can be reached from home.
    #[arg(long, value_name = "AXIS=FROM:TO:N", value_delimiter = ',', num_args = 1..)]
    range: Vec<Range>,
    /// Value of a coordinate that is not scanned.
    #[arg(long, value_name = "NAME=VALUE", value_delimiter = ',', num_args = 1..)]
    at: Vec<Value>,
    /// A third axis: one slice for each of its values.
    #[arg(long, value_name = "AXIS=FROM:TO:N")]
    slices: Option<Range>,
    /// How far ball and universal joints may lean from home, in degrees: all, or the one of that loop or joint.
    #[arg(long, value_name = "[NAME=]DEG", value_delimiter = ',', num_args = 1..)]
    cone: Vec<Cone>,
    /// Least distance from type 2 singularities: smallest singular value of dq/dx.
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    singularity_limit: f64,
    /// Largest condition number of dx/dq.
    #[arg(long, value_name = "X", default_value_t = f64::INFINITY)]
    condition_limit: f64,
    /// Metres are divided by this length to compare them with radians; with 1 the singular values are those in SI units.
    #[arg(long, value_name = "M", default_value_t = 1.0)]
    length: f64,
    /// Write a page with a picture of every slice.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Write every cell as a line.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Print nothing but errors.
    #[arg(short, long)]
    quiet: bool,
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let file = args.robot.display().to_string();
    let description = robot_file::read(&args.robot)?;
    let model = &description.robot.model;
    let targets: Vec<PathBuf> = [&args.html, &args.csv].into_iter().flatten().cloned().collect();
    let urdf = crate::outputs::folder(&args.robot).join(&description.spec.urdf);
    let mut outputs = Outputs::reserve(&targets, &[args.robot.as_path(), Path::new(&urdf)])?;
    let plan = Plan::new(args, model).map_err(|e| anyhow!("{file}: {e:#}"))?;
    let slices = scan(&plan, args.quiet)?;
    let (cones, scan) = plan.finish(slices);
    if let Some(path) = &args.html {
        outputs.write(path, &pkm_report::workspace_html(&scan, model, &cones))?;
    }
    if let Some(path) = &args.csv {
        outputs.write(path, &files::csv(&scan, model, &cones))?;
    }
    outputs.publish()?;
    if args.json {
        out::say(&out::clean(&serde_json::to_string(&files::json(&scan, model, &cones))?))?;
    } else if !args.quiet {
        let style = if out::is_coloured() { Style::Colour } else { Style::Plain };
        out::say(pkm_report::workspace_terminal(&scan, model, &cones, style).trim_end())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Every slice, one thread per core; each slice is computed from home alone, so their order does not matter.
fn scan(plan: &Plan<'_>, quiet: bool) -> anyhow::Result<Vec<Slice>> {
    let n = plan.n_slices();
    let (next, done, cells) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
    let results: Mutex<Vec<Option<Slice>>> = Mutex::new(vec![None; n]);
    let work = || {
        let mut scanner = plan.scanner.clone();
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            if i >= n {
                break;
            }
            let slice = plan.slice(&mut scanner, i, &mut || {
                cells.fetch_add(1, Ordering::Relaxed);
            });
            if let Ok(mut all) = results.lock() {
                all[i] = Some(slice);
            }
            done.fetch_add(1, Ordering::Release);
        }
    };
    let mut progress = Progress::new("scanning", quiet);
    thread::scope(|scope| {
        let threads = thread::available_parallelism().map_or(1, usize::from).min(n);
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        while handles.iter().any(|h| !h.is_finished()) {
            thread::sleep(Duration::from_millis(20));
            // Cells that do not close are counted when their slice is done.
            let share = cells.load(Ordering::Relaxed).max(done.load(Ordering::Acquire) * plan.n_cells());
            progress.update(share as f64 / (n * plan.n_cells()) as f64);
        }
    });
    let all = results.into_inner().map_err(|_| anyhow!("a slice was not finished"))?;
    all.into_iter().collect::<Option<Vec<Slice>>>().ok_or_else(|| anyhow!("a slice was not finished"))
}

impl Plan<'_> {
    /// The finished scan, and the cones that its causes refer to.
    fn finish(self, slices: Vec<Slice>) -> (Vec<pkm_dyn::workspace::Cone>, Scan) {
        let mut scan = self.scan;
        scan.slices = slices;
        (self.scanner.cones().to_vec(), scan)
    }
}
