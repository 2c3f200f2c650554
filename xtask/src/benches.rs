//! `cargo xtask benches`: every side-by-side measurement in turn, and their ratios in one table, docs/BENCHES.md.

use std::fs;
use std::path::Path;

use crate::latency;
use crate::peers::{self, END};
use crate::shell::{program, root, run, target, timed};

/// Where the ratios go.
const SUMMARY: &str = "docs/BENCHES.md";

/// A measurement beside another program.
struct Measurement {
    /// Its command, and the mark of its table.
    command: &'static str,
    /// What is measured, and beside what.
    says: &'static str,
    /// Arguments with which it takes as little time as it can.
    short: &'static [&'static str],
    work: fn(&[&str]) -> Result<(), String>,
    ratios: fn(&[Row]) -> Vec<Ratio>,
}

/// Cells of a line of a table.
type Row = Vec<String>;

/// Of ours to theirs, and what it is about.
type Ratio = (String, f64);

const ALL: [Measurement; 6] = [
    Measurement {
        command: "peers",
        says: "mechanics, time per call, beside Pinocchio's C++",
        short: &["--rounds", "2"],
        work: peers::peers,
        ratios: |rows| column(rows, "ours / their best"),
    },
    Measurement {
        command: "slicot",
        says: "structured singular values, time per bound, beside SLICOT's AB13MD",
        short: &["50"],
        work: peers::slicot,
        ratios: |rows| column(rows, "ours / theirs"),
    },
    Measurement {
        command: "identify-peers",
        says: "identification, time from recordings to parameters, beside cvxpy, scipy, figaroh; regressors (goal 0.05), beside Pinocchio in Python",
        short: &["1"],
        work: peers::identify,
        ratios: identified,
    },
    Measurement {
        command: "plants",
        says: "a millisecond of simulation, beside the engine rapier",
        short: &["--", "--quick"],
        work: peers::plants,
        ratios: |rows| column(rows, "ours / theirs"),
    },
    Measurement {
        command: FLEET,
        says: "a fleet on a cluster, time beside one process's shared out without loss",
        short: &["2", "1"],
        work: peers::fleet,
        ratios: |rows| column(rows, "ours / ideal"),
    },
    // Beside bare loops that do nothing else; its columns are distributions, which no ratio stands for.
    Measurement {
        command: LATENCY,
        says: "wake-ups of a loop, beside bare sleeping",
        short: &["1"],
        work: latency::latency,
        ratios: |_| Vec::new(),
    },
];

/// The measurement beside what nothing can do better.
const FLEET: &str = "fleet";

/// The measurement without ratios.
const LATENCY: &str = "latency";

/// Text of a table whose command has not been run.
const UNMEASURED: &str = "Not measured yet";

/// Runs every measurement, then writes the ratios; with `--table` the ratios alone, from the tables that are there; with `--short` everything with as
/// little work as it can have, into a copy of both pages below the folder of build products: whether it runs, not how fast.
pub(crate) fn benches(rest: &[&str]) -> Result<(), String> {
    match rest {
        [] => {
            for m in &ALL {
                println!("== {}: {}", m.command, m.says);
                let (outcome, duration) = timed(|| (m.work)(&[]));
                outcome.map_err(|e| format!("{}: {e}", m.command))?;
                println!("   {:.0} s", duration.as_secs_f64());
            }
        }
        ["--table"] => {}
        ["--short"] => return short(),
        [other, ..] => return Err(format!("unexpected argument {other:?} (--table, --short)")),
    }
    let text = summary(&read(&peers::tables())?)?;
    fs::write(root().join(SUMMARY), &text).map_err(|e| format!("{SUMMARY}: {e}"))?;
    println!("{text}");
    Ok(())
}

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

fn short() -> Result<(), String> {
    let copy = target().join("benches-short.md");
    fs::write(&copy, read(&peers::tables())?).map_err(|e| format!("{}: {e}", copy.display()))?;
    let own = std::env::current_exe().map_err(|e| format!("this program: {e}"))?;
    for m in &ALL {
        println!("== {}: {}", m.command, m.says);
        let (outcome, duration) = timed(|| run(program(&own, &[m.command]).args(m.short).env(peers::TABLES, &copy)));
        outcome.map_err(|e| format!("{}: {e}", m.command))?;
        println!("   {:.0} s", duration.as_secs_f64());
    }
    println!("{}\nnumbers of a short run, kept nowhere but in {}", summary(&read(&copy)?)?, copy.display());
    Ok(())
}

/// The page of ratios.
fn summary(tables: &str) -> Result<String, String> {
    let mut out = String::from(
        "# Beside other programs\n\nRatios of our time to the other program's in one run on one machine; below one is faster. Written by\n\
         `cargo xtask benches`, which runs every measurement in turn; the full tables, with what was done and what was compared number by\n\
         number, are in benches/README.md. A commit with `+changes` had files that were not committed.\n\n\
         | measurement | cases | fastest | median | slowest | slower in | commit |\n|---|---|---|---|---|---|---|\n",
    );
    let (mut slower, mut missed) = (String::new(), String::new());
    let mut machines: Vec<String> = Vec::new();
    for m in &ALL {
        let (head, rows) = table(tables, m.command).ok_or_else(|| format!("no table of {} among the tables", m.command))?;
        if head.starts_with(UNMEASURED) {
            out += &format!("| {} | | | | | | not measured yet |\n", m.says);
            continue;
        }
        let mut ratios = (m.ratios)(&rows);
        missed += &missed_goal(&ratios);
        ratios.sort_by(|a, b| a.1.total_cmp(&b.1));
        let commit = head.split("commit ").nth(1).unwrap_or("unknown").trim_end_matches('.');
        machines.push(format!("- {}: {}", m.command, head.split("; commit").next().unwrap_or(&head)));
        let (Some(first), Some(last)) = (ratios.first(), ratios.last()) else {
            if m.command == LATENCY {
                out += &format!("| {} | | | | | | {commit} |\n", m.says);
                continue;
            }
            return Err(format!("the table of {} has no ratio", m.command));
        };
        let over: Vec<&Ratio> = ratios.iter().filter(|r| r.1 > 1.0 && m.command != FLEET).collect();
        let slower_in = if m.command == FLEET { "1 is ideal".to_string() } else { format!("{} of {}", over.len(), ratios.len()) };
        out += &format!(
            "| {} | {} | {:.2} | {:.2} | {:.2} | {slower_in} | {commit} |\n",
            m.says,
            ratios.len(),
            first.1,
            ratios[ratios.len() / 2].1,
            last.1
        );
        over.iter().for_each(|(what, ratio)| slower += &format!("- {what}: {ratio:.2}\n"));
    }
    if !slower.is_empty() {
        out += &format!("\nWhere the other program is faster:\n\n{slower}");
    }
    out += &missed;
    out += "\nWhat other methods find on the blind trials is a question of numbers, not of time: `cargo xtask prove-baselines`, docs/PROOF.md.\n";
    out += &format!("\nMachines and versions:\n\n{}\n", machines.join("\n"));
    Ok(out)
}

/// A sentence where regressors take more of a Python loop's time than was aimed at.
fn missed_goal(ratios: &[Ratio]) -> String {
    let ours = ratios.iter().filter(|(what, _)| what.contains("regressor(") || *what == INTO.replace('`', ""));
    match ours.map(|(_, ratio)| *ratio).min_by(f64::total_cmp) {
        Some(best) if best > GOAL => format!(
            "\nMissed: an array of regressors takes {best:.2} of the time of a Python loop over Pinocchio at best, the goal is {GOAL}; \
             benches/README.md says what bounds it.\n"
        ),
        _ => String::new(),
    }
}

/// The first line after a command's mark, and the rows of all its tables, heads included.
fn table(text: &str, command: &str) -> Option<(String, Vec<Row>)> {
    let (_, rest) = text.split_once(&format!("<!-- cargo xtask {command} -->"))?;
    let (part, _) = rest.split_once(END)?;
    let head = part.lines().find(|l| !l.trim().is_empty())?.to_string();
    let cells = |line: &str| line.trim_matches('|').split('|').map(|c| c.trim().to_string()).collect();
    Some((head, part.lines().filter(|l| l.starts_with('|') && !l.starts_with("|---")).map(cells).collect()))
}

/// Numbers of a column, in the tables that have it, named by the two cells before everything else.
fn column(rows: &[Row], name: &str) -> Vec<Ratio> {
    let (mut k, mut width, mut out) = (None, 0, Vec::new());
    for row in rows {
        if let Some(found) = row.iter().position(|cell| cell == name) {
            (k, width) = (Some(found), row.len());
        } else if let Some(number) = k.filter(|_| row.len() == width).and_then(|k| row[k].parse().ok()) {
            out.push((row[..2.min(row.len())].join(", "), number));
        }
    }
    out
}

/// Part of a Python loop's time that an array of regressors is to take.
const GOAL: f64 = 0.05;

/// The row of a regressor that is written where an array is already.
const INTO: &str = "the same with `out=`";

/// Time of `sdp` over that of every peer, and those of the regressors, each over that of the next row of Pinocchio.
fn identified(rows: &[Row]) -> Vec<Ratio> {
    let time = |row: &Row, unit: &str| row.get(1).and_then(|cell| cell.strip_suffix(unit)).and_then(|s| s.parse::<f64>().ok());
    let seconds = |row: &Row| time(row, " s");
    let in_a_loop = |at: usize| rows[at..].iter().find(|r| r[0].starts_with("Pinocchio")).and_then(|r| time(r, " ms"));
    let is_ours = |row: &Row| row[0].starts_with("`pkm`") || row[0] == INTO;
    let regressors = rows.iter().enumerate().filter(|(_, row)| is_ours(row));
    let regressors: Vec<Ratio> =
        regressors.filter_map(|(at, row)| Some((row[0].replace('`', ""), time(row, " ms")? / in_a_loop(at)?))).collect();
    let Some(ours) = rows.iter().find(|r| r[0].starts_with("pkm, `sdp`")).and_then(seconds) else { return Vec::new() };
    let peers = rows.iter().filter(|r| !r[0].contains("pkm"));
    peers.filter_map(|row| seconds(row).map(|theirs| (row[0].clone(), ours / theirs))).chain(regressors).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLES: &str = "x\n<!-- cargo xtask peers -->\nCPU; commit abc, 2026-01-01.\n\n| robot | algorithm | ours / their best |\n|---|---|---|\n\
        | a | rnea | 0.50 |\n| a | crba | 1.25 |\n<!-- end -->\n<!-- cargo xtask slicot -->\nCPU; commit abc, d.\n| p | n | ours / theirs |\n|---|---|---|\n\
        | m | 2 | 0.1 |\n<!-- end -->\n<!-- cargo xtask identify-peers -->\nCPU; commit abc, d.\n| i | t |\n|---|---|\n| pkm, `sdp` | 1.0 s |\n\
        | pkm, `wls` | 9.0 s |\n| cvxpy | 2.0 s |\n\n| r | t | |\n|---|---|---|\n\
        | `pkm`, `regressor(q)` | 30 ms | |\n| the same with `out=` | 20 ms | |\n| numpy writing | 9 ms | |\n| Pinocchio in a loop | 200 ms | |\n\
        | `pkm`, `products` | 90 ms | |\n| Pinocchio, then numpy | 300 ms | |\n<!-- end -->\n<!-- cargo xtask plants -->\nNot measured yet: later.\n<!-- end -->\n\
        <!-- cargo xtask fleet -->\nCPU; commit abc, d.\n| d | how | ours / ideal |\n|---|---|---|\n| 16 | one process | |\n| 16 | 2 workers | 1.10 |\n\
        <!-- end -->\n<!-- cargo xtask latency -->\nCPU; commit abc, d.\n```text\nrows\n```\n<!-- end -->\n";

    #[test]
    fn ratios_are_read_from_the_tables_and_losses_are_told() {
        let page = summary(TABLES).unwrap();
        assert!(page.contains("| 2 | 0.50 | 1.25 | 1.25 | 1 of 2 | abc, 2026-01-01 |"), "{page}");
        assert!(page.contains("- a, crba: 1.25\n") && !page.contains("rnea: 0.5"), "{page}");
        // 20 of 200 ms, 30 of 200, 90 of 300, 1 of 2 s.
        assert!(page.contains("| 4 | 0.10 | 0.30 | 0.50 | 0 of 4 |"), "identification: {page}");
        assert!(page.contains("Missed: an array of regressors takes 0.10 of the time"), "{page}");
        assert!(!summary(&TABLES.replace("| 20 ms", "| 9 ms")).unwrap().contains("Missed"));
        assert!(page.contains("| 1 | 1.10 | 1.10 | 1.10 | 1 is ideal |") && !page.contains("- 16, 2 workers"), "fleet: {page}");
        assert!(page.contains("rapier | | | | | | not measured yet |") && page.contains("sleeping | | | | | | abc, d |"), "{page}");
    }

    #[test]
    fn a_table_without_ratios_is_an_error() {
        assert!(summary(&TABLES.replace("ours / theirs", "ours")).is_err());
    }
}
