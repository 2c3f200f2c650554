//! `cargo xtask atlas`: numbers and pictures of the guide's pages on effects, written by pkm itself.
//!
//! A page is written by hand, but for what stands after its mark, which says robot, joint, what to draw over, and what to conceal.

use std::fs;
use std::path::{Path, PathBuf};

use crate::guide::{built, pages};
use crate::peers::{END, between};
use crate::picture::{Panel, Table, derivative, svg};
use crate::shell::{output, program, root, target};

/// Folder of the pages; their pictures are in `pictures/` below.
const PAGES: &str = "docs/guide/src/effects";

/// A mark begins so; after it robot, joint, axis, and what is concealed.
const MARK: &str = "<!-- cargo xtask atlas: ";

/// Both recordings of a diagnosis.
const RECORDED: [&str; 4] = ["--duration", "20", "--rate", "500"];

/// The motion that is drawn, without noise.
const DRAWN: [&str; 8] = ["--duration", "10", "--rate", "250", "--noise", "none", "--seed", "3"];

/// What a mark says.
struct Case<'a> {
    /// The whole line of the mark.
    mark: &'a str,
    robot: &'a str,
    joint: &'a str,
    axis: &'a str,
    hide: &'a str,
}

/// Makes the generated part of every page anew, or of the pages named.
pub(crate) fn atlas(only: &[&str]) -> Result<(), String> {
    let programs = built()?;
    let pages = pages(&root().join(PAGES))?;
    for name in only {
        pages.iter().find(|p| stem(p) == *name).ok_or_else(|| format!("{PAGES}: no page {name}"))?;
    }
    for page in pages.iter().filter(|p| only.is_empty() || only.contains(&stem(p).as_str())) {
        let old = fs::read_to_string(page).map_err(|e| format!("{}: {e}", page.display()))?;
        let Some(case) = case(&old) else { continue };
        println!("   {}: {}", stem(page), case.hide);
        let made = make(&programs.join("pkm"), &stem(page), &case).map_err(|e| format!("{}: {e}", page.display()))?;
        let new = between(&old, case.mark, &made).ok_or_else(|| format!("{}: no {END:?} after the mark", page.display()))?;
        fs::write(page, new).map_err(|e| format!("{}: {e}", page.display()))?;
    }
    Ok(())
}

fn stem(page: &Path) -> String {
    page.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn case(page: &str) -> Option<Case<'_>> {
    let mark = page.lines().find(|l| l.starts_with(MARK))?;
    let words: Vec<&str> = mark.strip_prefix(MARK)?.strip_suffix(" -->")?.split(' ').collect();
    let [robot, joint, axis, hide] = words[..] else { return None };
    Some(Case { mark, robot, joint, axis, hide })
}

/// The generated part of a page; its picture is written beside it.
fn make(pkm: &Path, effect: &str, case: &Case<'_>) -> Result<String, String> {
    let folder = target().join("atlas").join(effect);
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let ask = |arguments: &[&str]| output(program(pkm, arguments).current_dir(&folder).env("NO_COLOR", "1"));
    let simulate = |out: &str, more: &[&str]| ask(&[&["simulate", case.robot, "--out", out, "--force", "--quiet"], more].concat());
    let hidden = ["--hide", case.hide];
    simulate("without.csv", &DRAWN)?;
    simulate("with.csv", &[&DRAWN[..], &hidden].concat())?;
    for (file, seed) in [("A.csv", "1"), ("B.csv", "2")] {
        simulate(file, &[&RECORDED[..], &["--seed", seed], &hidden].concat())?;
    }
    let entry = ask(&["effects", effect])?;
    let verdict = ask(&["diagnose", case.robot, "--recording", "A.csv", "--holdout", "B.csv", "--no-replay"])?;
    let (width, kilobytes) = draw(&folder, effect, case, units(&ask(&["check", case.robot])?, case.joint))?;
    println!("      picture of {width} panel(s), {kilobytes:.1} kB; {}", verdict.lines().next().unwrap_or_default());
    let simulations: String = [("A.csv", "1"), ("B.csv", "2")]
        .map(|(file, seed)| {
            format!("$ pkm simulate {} --out {file} --seed {seed} {} --hide '{}'\n", case.robot, RECORDED.join(" "), case.hide)
        })
        .concat();
    Ok(format!(
        "![What the effect adds to the effort of {joint}](pictures/{effect}.svg)\n\n\
         *Two runs of `{robot}` on one motion, with `{hide}` and without: the difference of the efforts of {joint}.*\n\n\
         ## The catalogue's entry\n\n```text\n{}\n```\n{}\n\
         ## What a diagnosis says of it\n\n```console\n{simulations}$ pkm diagnose {robot} --recording A.csv --holdout B.csv\n```\n\n```text\n{}\n```\n",
        entry.trim_end(),
        see_also(&entry),
        shortened(&verdict),
        joint = case.joint,
        robot = case.robot,
        hide = case.hide,
    ))
}

/// Links to the pages of the look-alikes that an entry names.
fn see_also(entry: &str) -> String {
    let lines = entry.lines().skip_while(|l| !l.starts_with("Easily confused with")).skip(1);
    let names: Vec<String> =
        lines.filter_map(|l| l.strip_prefix("  ").filter(|l| !l.starts_with(' '))).map(|name| format!("[{name}]({name}.md)")).collect();
    if names.is_empty() { String::new() } else { format!("\nTheir pages: {}\n", names.join(", ")) }
}

/// The verdict up to its findings; what was rejected fills a page and is in the report.
fn shortened(verdict: &str) -> String {
    let is_end = |l: &str| {
        ["Replayed", "Unexplained", "Ruled out", "Smallest visible", "Not to be seen", "Recordings", "Notes"]
            .iter()
            .any(|w| l.starts_with(w))
    };
    let mut out: Vec<&str> = Vec::new();
    let (mut is_skipping, mut is_table) = (false, false);
    for line in verdict.lines().take_while(|l| !is_end(l)) {
        let goes_on = line.starts_with("               ");
        is_skipping = line.starts_with("   rejected") || line.starts_with("     to be sure") || is_skipping && goes_on;
        is_table = line.starts_with("  joint ") || is_table && !line.is_empty();
        if !is_skipping && !is_table {
            out.push(line);
        }
    }
    out.dedup();
    out.join("\n").trim_end().to_string()
}

/// Units of position and effort of a joint, from what `pkm check` says.
fn units(checked: &str, joint: &str) -> (&'static str, &'static str) {
    let is_slider = checked.lines().any(|l| l.split_whitespace().take(2).eq([joint, "prismatic"]));
    if is_slider { ("m", "N") } else { ("rad", "N·m") }
}

/// Draws the difference of the efforts over time, and over the axis that shows the effect; how many panels, and how many kB.
fn draw(folder: &Path, effect: &str, case: &Case<'_>, unit: (&str, &str)) -> Result<(usize, f64), String> {
    let [with, without] = ["with.csv", "without.csv"].map(|name| Table::read(&folder.join(name)));
    let (with, without) = (with?, without?);
    let column = |table: &Table, kind: &str| table.column(&format!("{kind}.{}", case.joint));
    let (tau, base) = (column(&with, "tau")?, column(&without, "tau")?);
    let added: Vec<f64> = tau.iter().zip(&base).map(|(a, b)| a - b).collect();
    let time = without.column("t")?;
    let speed = column(&without, "dq_ref")?;
    let (x, label) = match case.axis {
        "time" => (None, String::new()),
        "position" => (Some(column(&without, "q_ref")?), format!("position [{}]", unit.0)),
        "velocity" => (Some(speed), format!("velocity [{}/s]", unit.0)),
        "acceleration" => (Some(derivative(&time, &speed)), format!("acceleration [{}/s²]", unit.0)),
        "effort" => (Some(base), format!("effort without it [{}]", unit.1)),
        other => return Err(format!("no axis {other:?} (time, position, velocity, acceleration, effort)")),
    };
    let mut panels = vec![Panel { x: &time, y: &added, label: "time [s]", is_line: true }];
    panels.extend(x.as_ref().map(|x| Panel { x, y: &added, label: &label, is_line: false }));
    let text = svg(&panels, &format!("added effort of {} [{}]", case.joint, unit.1));
    let file: PathBuf = root().join(PAGES).join("pictures").join(format!("{effect}.svg"));
    fs::create_dir_all(file.with_file_name("")).map_err(|e| format!("{}: {e}", file.display()))?;
    fs::write(&file, &text).map_err(|e| format!("{}: {e}", file.display()))?;
    Ok((panels.len(), text.len() as f64 / 1000.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_says_what_to_conceal_where_and_what_to_draw_over() {
        let page = "# x\n\n<!-- cargo xtask atlas: prs3 q1 velocity spring@q1:stiffness=4,rest=0 -->\n<!-- end -->\n";
        let case = case(page).unwrap();
        assert_eq!([case.robot, case.joint, case.axis, case.hide], ["prs3", "q1", "velocity", "spring@q1:stiffness=4,rest=0"]);
        assert!(super::case("no mark").is_none());
    }

    #[test]
    fn of_a_verdict_the_findings_stay() {
        let verdict = "r · 1 finding\n\n  joint   rms\n  q1      2\n\n1  spring at q1\n   rejected    x: because\n               of that\n     to be sure: do\n   held-out    5 %\nUnexplained\n  no\n";
        assert_eq!(shortened(verdict), "r · 1 finding\n\n1  spring at q1\n   held-out    5 %");
    }

    #[test]
    fn look_alikes_become_links() {
        assert_eq!(see_also("a\nEasily confused with:\n  b\n      told apart by: c\n"), "\nTheir pages: [b](b.md)\n");
        assert_eq!(see_also("a\n"), "");
    }
}
