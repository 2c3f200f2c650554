//! What the kernel says about itself, read from its files below a root that tests replace.

use std::fs;
use std::path::Path;

/// What a finding means for a control loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    Good,
    /// It works; it could be better.
    Note,
    /// It is in the way.
    Bad,
}

impl State {
    /// Its name for programs.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Note => "note",
            Self::Bad => "bad",
        }
    }

    /// Its mark for people.
    pub(super) fn mark(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Note => "note",
            Self::Bad => "BAD ",
        }
    }
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Finding {
    pub(super) what: &'static str,
    pub(super) found: String,
    pub(super) state: State,
    /// What to do about it; empty where nothing is to be done.
    pub(super) advice: String,
}

impl Finding {
    /// A finding.
    pub(super) fn new(what: &'static str, found: &str, state: State, advice: &str) -> Self {
        Self { what, found: found.to_string(), state, advice: advice.to_string() }
    }
}

/// Everything that is written in files below `root`.
pub(super) fn look(root: &Path) -> Vec<Finding> {
    let text = |path: &str| fs::read_to_string(root.join(path)).ok().map(|text| text.trim().to_string());
    vec![
        kernel(text("proc/sys/kernel/osrelease")),
        preemption(text("sys/kernel/realtime").as_deref(), &text("proc/version").unwrap_or_default()),
        throttling(text("proc/sys/kernel/sched_rt_runtime_us").as_deref()),
        governors(&governors_in(root)),
        isolation(text("sys/devices/system/cpu/isolated").as_deref(), text("sys/devices/system/cpu/online").as_deref()),
        siblings(text("sys/devices/system/cpu/smt/active").as_deref()),
        clock(text("sys/devices/system/clocksource/clocksource0/current_clocksource").as_deref()),
        machine(text("proc/cpuinfo").as_deref()),
    ]
}

fn kernel(release: Option<String>) -> Finding {
    Finding::new("kernel", &release.unwrap_or_else(|| "unknown".to_string()), State::Good, "")
}

fn preemption(realtime: Option<&str>, version: &str) -> Finding {
    let what = "preemption";
    if realtime == Some("1") || version.contains("PREEMPT_RT") {
        return Finding::new(what, "PREEMPT_RT", State::Good, "");
    }
    let kind = ["PREEMPT_DYNAMIC", "PREEMPT"].into_iter().find(|kind| version.contains(kind)).unwrap_or("no preemption that is known");
    Finding::new(what, kind, State::Note, "install a PREEMPT_RT kernel: on others the latest wake-up has no bound")
}

fn throttling(runtime: Option<&str>) -> Finding {
    let what = "real-time share";
    match runtime {
        Some("-1") => Finding::new(what, "not throttled", State::Good, ""),
        Some(us) => Finding::new(what, &format!("{us} us of every second"), State::Good, ""),
        None => Finding::new(what, "unknown", State::Note, ""),
    }
}

/// Governor of every processor that has one.
fn governors_in(root: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(root.join("sys/devices/system/cpu")) else { return Vec::new() };
    let is_cpu = |name: &str| name.strip_prefix("cpu").is_some_and(|n| !n.is_empty() && n.chars().all(|c| c.is_ascii_digit()));
    let folders = entries.flatten().filter(|entry| is_cpu(&entry.file_name().to_string_lossy()));
    let mut out: Vec<String> =
        folders.filter_map(|e| fs::read_to_string(e.path().join("cpufreq/scaling_governor")).ok()).map(|g| g.trim().to_string()).collect();
    out.sort();
    out
}

fn governors(all: &[String]) -> Finding {
    let what = "frequency governor";
    let mut kinds = all.to_vec();
    kinds.dedup();
    let advice = "cpupower frequency-set -g performance";
    match kinds.as_slice() {
        [] => Finding::new(what, "none: the frequency is not this kernel's to choose", State::Good, ""),
        [one] if one == "performance" => Finding::new(what, one, State::Good, ""),
        kinds if kinds.iter().any(|kind| kind == "powersave") => Finding::new(what, &kinds.join(", "), State::Bad, advice),
        kinds => Finding::new(what, &kinds.join(", "), State::Note, advice),
    }
}

fn isolation(isolated: Option<&str>, online: Option<&str>) -> Finding {
    let what = "isolated cores";
    match isolated {
        Some(list) if !list.is_empty() => Finding::new(what, list, State::Good, ""),
        _ => {
            let found = format!("none of {}", online.filter(|list| !list.is_empty()).unwrap_or("those there are"));
            Finding::new(
                what,
                &found,
                State::Note,
                "isolcpus=N nohz_full=N rcu_nocbs=N on the kernel's command line, and the loop on core N",
            )
        }
    }
}

fn siblings(active: Option<&str>) -> Finding {
    let what = "hyper-threads";
    match active {
        Some("1") => {
            Finding::new(what, "on", State::Note, "echo off > /sys/devices/system/cpu/smt/control, or leave the loop's sibling idle")
        }
        _ => Finding::new(what, "off", State::Good, ""),
    }
}

fn clock(source: Option<&str>) -> Finding {
    let what = "clock source";
    match source {
        Some(fast @ ("tsc" | "arch_sys_counter" | "kvm-clock" | "hyperv_clocksource_tsc_page" | "riscv_clocksource")) => {
            Finding::new(what, fast, State::Good, "")
        }
        Some(slow) => Finding::new(
            what,
            slow,
            State::Bad,
            "every look at the clock is a call of the kernel and slow: tsc=reliable on its command line",
        ),
        None => Finding::new(what, "unknown", State::Note, ""),
    }
}

fn machine(cpuinfo: Option<&str>) -> Finding {
    let is_guest = cpuinfo.is_some_and(|text| {
        let flags = text.lines().find(|line| line.starts_with("flags"));
        flags.is_some_and(|line| line.split_whitespace().any(|flag| flag == "hypervisor"))
    });
    if is_guest {
        return Finding::new("machine", "virtual", State::Note, "its host decides when it runs: control robots from a real one");
    }
    Finding::new("machine", "real, as far as can be seen", State::Good, "")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A root with these files.
    fn root(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        folder
    }

    fn states(files: &[(&str, &str)]) -> Vec<(&'static str, State)> {
        let folder = root(files);
        look(folder.path()).into_iter().map(|finding| (finding.what, finding.state)).collect()
    }

    #[test]
    fn a_robot_computer_is_good() {
        let found = states(&[
            ("proc/sys/kernel/osrelease", "6.6.73-rt47\n"),
            ("sys/kernel/realtime", "1\n"),
            ("proc/version", "Linux version 6.6.73-rt47 (x) #1 SMP PREEMPT_RT\n"),
            ("proc/sys/kernel/sched_rt_runtime_us", "-1\n"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n"),
            ("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "performance\n"),
            ("sys/devices/system/cpu/isolated", "1\n"),
            ("sys/devices/system/cpu/smt/active", "0\n"),
            ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
            ("proc/cpuinfo", "flags\t: fpu vme\n"),
        ]);
        assert!(found.iter().all(|(_, state)| *state == State::Good), "{found:?}");
    }

    #[test]
    fn what_is_in_the_way_is_told_from_what_could_be_better() {
        let found = states(&[
            ("proc/version", "Linux version 6.18 #1 SMP PREEMPT_DYNAMIC\n"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n"),
            ("sys/devices/system/cpu/cpufreq/scaling_governor", "not a processor"),
            ("sys/devices/system/cpu/isolated", "\n"),
            ("sys/devices/system/cpu/smt/active", "1\n"),
            ("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n"),
            ("proc/cpuinfo", "processor: 0\nflags\t: fpu hypervisor vme\n"),
        ]);
        let of = |what: &str| found.iter().find(|(name, _)| *name == what).unwrap().1;
        assert_eq!([of("frequency governor"), of("clock source")], [State::Bad; 2]);
        assert_eq!([of("preemption"), of("isolated cores"), of("hyper-threads"), of("machine")], [State::Note; 4]);
    }

    #[test]
    fn advice_comes_with_everything_that_could_be_better() {
        let folder = root(&[("sys/devices/system/clocksource/clocksource0/current_clocksource", "acpi_pm")]);
        for finding in look(folder.path()) {
            let needs = finding.state != State::Good && finding.found != "unknown";
            assert_eq!(needs, !finding.advice.is_empty(), "{finding:?}");
        }
    }
}
