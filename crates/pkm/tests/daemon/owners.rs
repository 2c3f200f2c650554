//! Whose processes may be sides of a robot, and give it orders: the user's and the group's that the file names; nobody of another user.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

use crate::site::{CONFIG, Site};

/// User and group that own nothing.
const NOBODY: u32 = 65_534;

fn id(flag: &str) -> String {
    let told = Command::new("id").arg(flag).output().unwrap();
    String::from_utf8_lossy(&told.stdout).trim().to_string()
}

#[test]
fn a_side_of_another_user_or_group_than_the_file_names_does_not_begin() {
    let site = Site::new();
    let keyed = |line: &str| fs::write(site.config(), format!("{line}{CONFIG}")).unwrap();
    let other = id("-u").parse::<u32>().unwrap() + 1;
    for (line, want) in [
        (
            format!("user = \"{other}\""),
            format!("daemon.toml:1: user: \"{other}\": this process runs as uid {} (must be uid {other})", id("-u")),
        ),
        ("user = \"no such one\"".into(), "daemon.toml:1: user: \"no such one\": this machine has no such user".into()),
        ("\ngroup = \"4294967294\"".into(), "daemon.toml:2: group: \"4294967294\": this process is of the groups [".into()),
        ("group = \"no such one\"".into(), "daemon.toml:1: group: \"no such one\": this machine has no such group".into()),
    ] {
        keyed(&line);
        for verb in ["daemon", "driver-sim"] {
            let mut side = site.start(verb);
            assert_eq!(side.end(60), 78, "{}", side.told());
            assert!(side.told().contains(&want) && side.told().lines().count() == 1, "{}", side.told());
        }
        assert!(!site.dir.path().join("meet").exists());
    }
    keyed(&format!("user = \"{}\"\ngroup = \"{}\"", id("-un"), id("-gn")));
    let (_driver, _daemon) = (site.start("driver-sim"), site.start("daemon"));
    site.until(&["ready"]);
}

#[test]
fn nobody_of_another_user_can_be_a_side_or_give_an_order() {
    let site = Site::new();
    let (_driver, _daemon) = (site.start("driver-sim"), site.start("daemon"));
    site.until(&["ready"]);
    let meet = site.dir.path().join("meet");
    let about = fs::metadata(&meet).unwrap();
    assert_eq!((about.mode() & 0o777, fs::metadata(meet.join("control.sock")).unwrap().mode() & 0o777), (0o700, 0o600));
    // Only root can become somebody else; the kernel judges others by what was just looked at.
    if id("-u") != "0" {
        return;
    }
    fs::set_permissions(site.dir.path(), fs::Permissions::from_mode(0o755)).unwrap();
    // Where others can run it.
    let program = site.dir.path().join("pkm");
    fs::copy(env!("CARGO_BIN_EXE_pkm"), &program).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let run = |user: u32, arguments: &[&str]| {
        let mut command = Command::new(&program);
        command.args(arguments).arg(site.config()).uid(user).gid(user).current_dir("/").stdin(Stdio::null());
        let out = command.output().unwrap();
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    for verb in ["daemon", "driver-sim"] {
        let (code, told) = run(NOBODY, &[verb]);
        assert_eq!(code, Some(78), "{told}");
        assert!(told.contains("meet: belongs to uid 0 (must be a directory of uid 65534 with mode 0700"), "{told}");
    }
    for order in [&["order", "arm", "--config"][..], &["order", "quit", "--config"], &["status", "--config"]] {
        let (code, told) = run(NOBODY, order);
        assert!(code == Some(74) && told.contains("Permission denied"), "{order:?}: {code:?} {told}");
    }
    assert_eq!(site.phase(), "ready");
    // Who may, can.
    assert_eq!(run(0, &["order", "arm", "--config"]), (Some(0), String::new()));
    site.until(&["holding"]);
}
