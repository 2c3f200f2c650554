//! Help of every command, as a person asks for it: nothing is run.

use std::process::{Command, Output};

fn xtask(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_xtask")).args(arguments).output().expect("this program")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn every_command_says_how_it_is_used() {
    let all = xtask(&[]);
    let all = text(&all.stdout);
    let commands: Vec<&str> = all.lines().filter_map(|line| line.strip_prefix("cargo xtask ")?.split_whitespace().next()).collect();
    assert!(commands.len() > 15 && commands.contains(&"latency") && commands.contains(&"long"), "{commands:?}");
    for command in commands {
        for flag in ["--help", "-h"] {
            // What follows is not looked at any more.
            let told = xtask(&[command, flag, "nonsense"]);
            let said = text(&told.stdout);
            assert_eq!((told.status.code(), text(&told.stderr).as_str()), (Some(0), ""), "{command} {flag}: {said}");
            assert!(said.starts_with(&format!("cargo xtask {command} ")), "{command} {flag}: {said}");
            assert!(command == "test" || said.lines().count() == 1, "{said}");
        }
    }
    assert!(text(&xtask(&["test", "--help"]).stdout).contains("  clippy "));
    let told = xtask(&["no-such-command", "--help"]);
    assert_eq!((told.status.code(), text(&told.stdout).as_str()), (Some(1), ""));
    assert!(text(&told.stderr).starts_with("xtask: no command \"no-such-command\""), "{}", text(&told.stderr));
}
