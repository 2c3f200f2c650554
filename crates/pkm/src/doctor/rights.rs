//! What a control loop asks of the operating system, and whether it is granted: the daemon's own claim, made on a thread that ends.

use pkm_daemon::realtime::{Grants, Policy, claim};

use super::facts::{Finding, State};

/// Whether scheduling rights, locked memory and a processor that stays awake are granted.
pub(super) fn look(priority: u8) -> Vec<Finding> {
    let asked = std::thread::spawn(move || match claim(Policy::Prefer, None, priority) {
        Ok((grants, _)) | Err(grants) => grants,
    });
    told(&asked.join().unwrap_or_default(), priority)
}

fn told(grants: &Grants, priority: u8) -> Vec<Finding> {
    let fifo = format!("SCHED_FIFO {priority}");
    let of = |what: &'static str, asked: &str, is_granted: bool, otherwise: State| {
        if is_granted {
            return Finding::new(what, &format!("{asked}: granted"), State::Good, "");
        }
        // Each line is what is missing, why, and in brackets what gives it.
        let line = grants.missing.iter().find(|line| line.starts_with(asked)).map_or(asked, String::as_str);
        let (found, advice) = line.rsplit_once(" (").unwrap_or((line, ""));
        Finding::new(what, &format!("{found}: not granted"), otherwise, advice.trim_end_matches(')'))
    };
    vec![
        of("scheduling", &fifo, grants.fifo_priority > 0, State::Bad),
        of("memory", "locked memory", grants.is_locked, State::Bad),
        of("processor sleep", "a processor that stays awake", grants.is_awake, State::Note),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_granted_comes_with_what_gives_it() {
        let missing = [
            "locked memory: too little (`ulimit -l unlimited`, or LimitMEMLOCK=infinity in the unit)",
            "SCHED_FIFO 80: EPERM (`ulimit -r 95`)",
        ];
        let grants = Grants { missing: missing.map(String::from).to_vec(), is_awake: true, ..Grants::default() };
        let found = told(&grants, 80);
        let states: Vec<State> = found.iter().map(|finding| finding.state).collect();
        assert_eq!(states, [State::Bad, State::Bad, State::Good]);
        assert_eq!((found[0].found.as_str(), found[0].advice.as_str()), ("SCHED_FIFO 80: EPERM: not granted", "`ulimit -r 95`"));
        assert_eq!(found[1].advice, "`ulimit -l unlimited`, or LimitMEMLOCK=infinity in the unit");
    }
}
