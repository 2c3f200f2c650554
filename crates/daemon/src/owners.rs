//! Whose processes may be sides of a robot: a user and a group that a file names.
//!
//! The private directory keeps everybody else out; this keeps the right people from starting a side under a wrong name, where nobody would meet it.

use std::ffi::OsStr;

/// Whether this process runs as `user` and is of `group`, each a name or a number; none: anybody's.
///
/// # Errors
/// Which of both keys is offended, and how.
pub fn check([user, group]: [Option<&str>; 2]) -> Result<(), (&'static str, String)> {
    if let Some(name) = user {
        let uid = number(name, |name| uzers::get_user_by_name(name).map(|user| user.uid()));
        let own = rustix::process::geteuid().as_raw();
        let uid = uid.ok_or_else(|| ("user", format!("{name:?}: this machine has no such user")))?;
        if uid != own {
            return Err(("user", format!("{name:?}: this process runs as uid {own} (must be uid {uid})")));
        }
    }
    if let Some(name) = group {
        let gid = number(name, |name| uzers::get_group_by_name(name).map(|group| group.gid()));
        let gid = gid.ok_or_else(|| ("group", format!("{name:?}: this machine has no such group")))?;
        let own = groups();
        if !own.contains(&gid) {
            return Err(("group", format!("{name:?}: this process is of the groups {own:?} (must be of gid {gid})")));
        }
    }
    Ok(())
}

/// A name looked up, or a number as it is.
fn number(name: &str, look: impl Fn(&OsStr) -> Option<u32>) -> Option<u32> {
    name.parse().ok().or_else(|| look(OsStr::new(name)))
}

/// Groups of this process.
fn groups() -> Vec<u32> {
    let more = rustix::process::getgroups().unwrap_or_default();
    let mut all: Vec<u32> = core::iter::once(rustix::process::getegid()).chain(more).map(|gid| gid.as_raw()).collect();
    all.sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What another program says of this process.
    fn id(flag: &str) -> String {
        let told = std::process::Command::new("id").arg(flag).output().expect("coreutils");
        String::from_utf8_lossy(&told.stdout).trim().to_string()
    }

    #[test]
    fn names_and_numbers_that_are_ours_pass_and_others_are_told() {
        let (uid, user, groups, group) = (id("-u"), id("-un"), id("-G"), id("-gn"));
        assert_eq!(check([None, None]), Ok(()));
        for name in [&uid, &user] {
            assert_eq!(check([Some(name), None]), Ok(()));
        }
        for name in groups.split_whitespace().chain([group.as_str()]) {
            assert_eq!(check([Some(&user), Some(name)]), Ok(()), "{name}");
        }
        let other = uid.parse::<u32>().unwrap() + 1;
        let (key, told) = check([Some(&other.to_string()), None]).unwrap_err();
        assert_eq!((key, told), ("user", format!("\"{other}\": this process runs as uid {uid} (must be uid {other})")));
        let (key, told) = check([None, Some("4294967294")]).unwrap_err();
        assert!(key == "group" && told.ends_with("(must be of gid 4294967294)"), "{told}");
        for name in ["no such one", "", "a\0b", "-1"] {
            assert_eq!(check([Some(name), None]).map_err(|(key, _)| key), Err("user"));
            assert_eq!(check([None, Some(name)]).map_err(|(key, _)| key), Err("group"));
        }
    }
}
