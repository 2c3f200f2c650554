//! Completion in a shell, manual pages, colours, and JSON from every verb that answers.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::fixture::{demo, pkm, prints, refused, rig, rig_with_recordings};

#[expect(clippy::print_stdout, reason = "a test that could not run must say so")]
fn is_there(program: &str, arguments: &[&str]) -> bool {
    let answers = Command::new(program).args(arguments).output().is_ok_and(|o| o.status.success());
    if !answers {
        println!("not run: {program} is not installed");
    }
    answers
}

/// What bash would offer for the last of `words`, with the script that `pkm completions bash` prints.
fn offered(folder: &Path, words: &[&str]) -> Vec<String> {
    let script = concat!(
        "source pkm.bash; COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1)); COMP_LINE=\"$*\"; COMP_POINT=${#COMP_LINE}; ",
        "complete -p pkm >/dev/null || exit 3; _pkm pkm \"${COMP_WORDS[COMP_CWORD]}\" \"${COMP_WORDS[COMP_CWORD-1]}\"; ",
        "printf '%s\\n' \"${COMPREPLY[@]}\""
    );
    let output = Command::new("bash").args(["--norc", "-c", script, "bash"]).args(words).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_string).collect()
}

#[test]
fn bash_completes_verbs_flags_and_values() {
    if !is_there("bash", &["--version"]) {
        return;
    }
    let folder = rig();
    fs::write(folder.path().join("pkm.bash"), prints(folder.path(), &["completions", "bash"])).unwrap();
    assert_eq!(offered(folder.path(), &["pkm", "dia"]), ["diagnose"]);
    assert_eq!(offered(folder.path(), &["pkm", "diagnose", "--hold"]), ["--holdout"]);
    assert_eq!(offered(folder.path(), &["pkm", "completions", "f"]), ["fish"]);
    assert_eq!(offered(folder.path(), &["pkm", "export", "rig.toml", "--format", "m"]), ["mjcf"]);
    let effects = offered(folder.path(), &["pkm", "effects", "friction_"]);
    let named: Vec<&str> = pkm_dyn::effects::CATALOGUE.iter().map(|e| e.name).filter(|n| n.starts_with("friction_")).collect();
    assert_eq!(effects, named);
    let files = offered(folder.path(), &["pkm", "diagnose", "rig.toml", "--recording", "rig.u"]);
    assert_eq!(files, ["rig.urdf"]);
}

/// What a shell, the words that begin it, prints of a script, with `pkm` among its commands.
fn answer(folder: &Path, shell: &[&str], script: &str) -> String {
    let own = Path::new(env!("CARGO_BIN_EXE_pkm")).parent().unwrap().to_path_buf();
    let others = std::env::var_os("PATH").unwrap_or_default();
    let path = std::env::join_paths(core::iter::once(own).chain(std::env::split_paths(&others))).unwrap();
    let mut command = Command::new(shell[0]);
    let output = command.args(&shell[1..]).arg(script).env("PATH", path).env("HOME", folder).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{:?} {}", output.status, String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn fish_completes_verbs_flags_and_their_values() {
    if !is_there("fish", &["--version"]) {
        return;
    }
    let folder = rig();
    let offered = |line: &str| -> Vec<String> {
        let told = answer(folder.path(), &["fish", "-c"], &format!("pkm completions fish | source; complete -C '{line}'"));
        told.lines().filter_map(|l| l.split('\t').next()).map(str::to_string).collect()
    };
    assert_eq!(offered("pkm dia"), ["diagnose"]);
    assert_eq!(offered("pkm diagnose --hold"), ["--holdout"]);
    assert_eq!(offered("pkm twin --follow "), ["measured", "reference"]);
}

// Zsh completes at a terminal only: it gets one here, and each step waits for what the last must show.
#[test]
fn zsh_completes_a_verb() {
    if !is_there("zsh", &["--version"]) || !is_there("timeout", &["--version"]) {
        return;
    }
    let script = "zmodload zsh/zpty; zpty w zsh -f
        zpty -w w 'autoload -Uz compinit; compinit -u -D; source <(pkm completions zsh); print REA\"\"DY'
        zpty -r -m w shown '*READY*'
        zpty -n -w w $'pkm dia\\t'
        zpty -r -m w shown '*pkm diagnose*' && print completed
        zpty -d w";
    assert_eq!(answer(rig().path(), &["timeout", "60", "zsh", "-f", "-c"], script), "completed\n");
}

#[test]
fn every_shell_gets_every_verb() {
    let folder = rig();
    let help = prints(folder.path(), &["--help"]);
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = prints(folder.path(), &["completions", shell]);
        for verb in ["check", "diagnose", "driver-sim", "completions"] {
            assert!(help.contains(verb) && script.contains(verb), "{shell} lacks {verb}");
        }
    }
    refused(folder.path(), &["completions", "cmd"], &["cmd", "powershell"]);
}

/// The verbs that the help lists.
fn verbs(folder: &Path) -> Vec<String> {
    let help = prints(folder, &["--help"]);
    let listed = help.lines().filter_map(|l| l.strip_prefix("  ")).filter(|l| l.starts_with(|c: char| c.is_ascii_lowercase()));
    listed.filter(|l| !l.starts_with("pkm ")).filter_map(|l| l.split_whitespace().next()).map(str::to_string).collect()
}

#[test]
fn the_help_of_every_verb_ends_with_examples_of_it() {
    let folder = rig();
    for verb in verbs(folder.path()) {
        let help = prints(folder.path(), &[&verb, "--help"]);
        let (_, examples) = help.split_once("\nExamples:\n").unwrap_or_else(|| panic!("{verb}: no examples"));
        assert!(examples.contains(&format!("  pkm {verb}")), "{verb}: {examples}");
    }
}

#[test]
fn every_verb_has_a_manual_page_that_renders() {
    let folder = rig();
    prints(folder.path(), &["man", "--out", "man"]);
    let pages = crate::fixture::names(&folder.path().join("man"));
    let mut wanted: Vec<String> = verbs(folder.path()).iter().map(|v| format!("pkm-{v}.1")).chain(["pkm.1".to_string()]).collect();
    wanted.sort();
    assert_eq!(pages, wanted);
    if !is_there("groff", &["--version"]) {
        return;
    }
    for page in &pages {
        // All warnings but those of lines that cannot be broken: a command is not to be.
        let arguments = ["-man", "-ww", "-Wbreak", "-rHY=0", "-Kutf8", "-Tutf8", page.as_str()];
        let output = Command::new("groff").args(arguments).current_dir(folder.path().join("man")).output().unwrap();
        assert_eq!((output.status.success(), String::from_utf8_lossy(&output.stderr).as_ref()), (true, ""), "{page}");
    }
    let arguments = ["-man", "-rHY=0", "-rLL=200n", "-Kutf8", "-Tutf8", "-P-cbou", "pkm-diagnose.1"];
    let text = Command::new("groff").args(arguments).current_dir(folder.path().join("man")).output().unwrap();
    // Some settings of groff turn a minus that is typed into one that is printed.
    let text = String::from_utf8(text.stdout).unwrap().replace(['\u{2212}', '\u{2010}'], "-");
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    // Commands stand on lines of their own, as they are to be typed.
    let command = "pkm diagnose robot.toml --recording A.csv --holdout B.csv --html out.html";
    for line in ["NAME", "SYNOPSIS", "OPTIONS", "EXAMPLES", command] {
        assert!(lines.contains(&line), "{text}\nlacks the line {line:?}");
    }
}

/// The same command within a terminal of `script`; what it wrote.
fn in_a_terminal(folder: &Path, line: &str, variables: &[(&str, &str)]) -> String {
    let command = format!("{} {line}", env!("CARGO_BIN_EXE_pkm"));
    let mut script = Command::new("script");
    script.args(["-qec", &command, "/dev/null"]).current_dir(folder).env_remove("NO_COLOR").env("TERM", "xterm-256color");
    let output = script.envs(variables.iter().copied()).stdin(std::process::Stdio::null()).output().unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn colours_are_for_terminals_and_can_be_refused() {
    let folder = rig_with_recordings();
    let plain = "plan rig.toml --reference A.csv --noise 0.1 -v";
    let piped = Command::new(env!("CARGO_BIN_EXE_pkm"))
        .args(plain.split(' '))
        .current_dir(folder.path())
        .env_remove("NO_COLOR")
        .env("TERM", "xterm-256color")
        .output()
        .unwrap();
    assert!(piped.status.success() && !piped.stderr.is_empty(), "the log is told");
    assert!(!piped.stdout.contains(&0x1b) && !piped.stderr.contains(&0x1b), "{}", String::from_utf8_lossy(&piped.stderr));
    if !is_there("script", &["--version"]) {
        return;
    }
    // A colour is a sequence that ends in m; a progress bar, which moves the cursor, is none.
    let ends_in_m = |rest: &str| rest.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';').starts_with('m');
    let is_coloured = |text: &str| text.split("\u{1b}[").skip(1).any(ends_in_m);
    assert!(is_coloured(&in_a_terminal(folder.path(), plain, &[])));
    for off in [("NO_COLOR", "1"), ("TERM", "dumb")] {
        let text = in_a_terminal(folder.path(), plain, &[off]);
        assert!(text.contains("rig") && !is_coloured(&text), "{off:?}: {text:?}");
    }
}

fn json(folder: &Path, line: &str) -> Value {
    let output = pkm(folder, &line.split_whitespace().collect::<Vec<_>>());
    let text = String::from_utf8(output.stdout).unwrap();
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{line}: {e}: {text}{}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn verbs_that_write_files_tell_of_them_as_json() {
    let folder = rig_with_recordings();
    let told = json(folder.path(), "convert A.csv new.mcap --json");
    let read = pkm_record::read(&folder.path().join("new.mcap"), &pkm_record::ReadOptions::default()).unwrap();
    assert_eq!((&told["schema"], &told["samples"]), (&"pkm.convert/1".into(), &read.len().into()));
    assert_eq!(told["signals"].as_array().unwrap().len(), read.signals.len());
    assert!((told["duration_s"].as_f64().unwrap() - read.duration()).abs() < 1e-9);
    let told = json(folder.path(), "export rig.toml --format gepetto --out new --json");
    for file in told["files"].as_array().unwrap() {
        assert!(folder.path().join(file.as_str().unwrap()).is_file(), "{file}");
    }
    assert_eq!((told["schema"].as_str(), told["robot"].as_str()), (Some("pkm.export/1"), Some("rig")));
}

#[test]
fn a_dash_prints_what_else_goes_into_a_file() {
    let folder = rig_with_recordings();
    let before = crate::fixture::names(folder.path());
    for (line, schema) in [
        ("diagnose rig.toml --recording A.csv --holdout B.csv --null-runs 39 --no-replay --json -", "pkm.verdict/1"),
        ("identify rig.toml --recording A.csv --holdout B.csv --json -", "pkm.identification/1"),
        ("plan rig.toml --reference A.csv --noise 0.1 --json -", "pkm.plan/1"),
        ("trial-null rig.toml --recording A.csv --runs 1 --null-runs 39 --json -", "pkm.null/1"),
    ] {
        assert_eq!(json(folder.path(), line)["schema"], schema, "{line}");
        assert_eq!(crate::fixture::names(folder.path()), before, "{line}");
    }
    // The same bytes as in a file, but for the refined robot, which lies beside a file alone.
    prints(folder.path(), &"plan rig.toml --reference A.csv --noise 0.1 --json plan.json --quiet".split(' ').collect::<Vec<_>>());
    let printed = prints(folder.path(), &"plan rig.toml --reference A.csv --noise 0.1 --json -".split(' ').collect::<Vec<_>>());
    assert_eq!(printed, fs::read_to_string(folder.path().join("plan.json")).unwrap());
    let both = ["plan", "rig.toml", "--reference", "A.csv", "--noise", "0.1", "--json", "-", "--html", "-"];
    refused(folder.path(), &both, &["standard output", "two outputs"]);
}

#[test]
fn the_demo_tells_its_outcome_as_json() {
    let folder = rig();
    let told = json(folder.path(), "demo --robot rig.toml --effect friction_coulomb --duration 10 --out demo --json");
    let verdict: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("demo/verdict.json")).unwrap()).unwrap();
    let sealed: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("demo/sealed.json")).unwrap()).unwrap();
    assert_eq!((&told["schema"], &told["is_right"]), (&"pkm.demo/1".into(), &true.into()));
    assert_eq!((&told["findings"], &told["heldout"]), (&verdict["findings"], &verdict["heldout"]));
    assert_eq!(told["concealed"][0]["effect"], sealed["concealed"][0]["effect"]);
    let story = fs::read_to_string(demo().join("told.txt")).unwrap();
    assert!(story.contains("The effect is named"), "the story of the same run says the same");
}

#[test]
fn a_misspelt_effect_is_answered_with_the_one_that_was_meant() {
    let folder = rig();
    refused(folder.path(), &["effects", "friction_stribek"], &["friction_stribek", "similar", "friction_stribeck"]);
    refused(folder.path(), &["demo", "--effect", "backlsh", "--out", "x"], &["backlsh", "similar", "backlash"]);
}
