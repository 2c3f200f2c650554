//! `pkm order`: tells a running daemon what to do.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueEnum;
use pkm_daemon::control;
use serde_json::Value;

use crate::daemon::setup::directory_of;
use crate::daemon::{CONFIGURATION, IO, refuse};
use crate::out;

/// Arguments of `pkm order`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
arm         enable: the robot stands up where it is, or goes to its home; from ready
start       play the motion, the law of contact or the exercise; from holding
stop        slow down along the path and hold
safe-stop   the safe action, now
clear-fault reset after a safe stop or a fault; the robot does not move until it is armed again
off         power off; from ready, holding, or a safe stop
quit        stop, switch off, and end the daemon

Exit codes: 0 done, 1 refused by the daemon, 74 no daemon answers, 78 the configuration is wrong.

Examples:
  pkm order arm
  pkm order stop --config daemon.toml")]
pub(crate) struct Args {
    /// What to do.
    order: OrderName,
    /// The daemon's own daemon.toml [default: the shipped example].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print the daemon's answer as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OrderName {
    /// Enable.
    Arm,
    /// Play.
    Start,
    /// Slow down and hold.
    Stop,
    /// The safe action.
    SafeStop,
    /// Reset.
    ClearFault,
    /// Power off.
    Off,
    /// End the daemon.
    Quit,
}

impl OrderName {
    const fn text(self) -> &'static str {
        match self {
            Self::Arm => "arm",
            Self::Start => "start",
            Self::Stop => "stop",
            Self::SafeStop => "safe-stop",
            Self::ClearFault => "clear-fault",
            Self::Off => "off",
            Self::Quit => "quit",
        }
    }
}

/// Runs the verb.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let directory = match directory_of(args.config.as_deref()) {
        Ok(directory) => directory,
        Err(e) => return Ok(refuse(CONFIGURATION, &format!("{e:#}"))),
    };
    let answer = match control::ask(&directory, args.order.text()) {
        Ok(answer) => answer,
        Err(e) => {
            return Ok(refuse(
                IO,
                &format!("{}: no daemon answers: {e} (`pkm daemon` starts one)", directory.join(control::SOCKET).display()),
            ));
        }
    };
    if args.json {
        out::say(answer.trim_end())?;
    }
    let answer: Value = serde_json::from_str(&answer)?;
    if answer["ok"] == Value::Bool(true) {
        if !args.json {
            out::say(args.order.text())?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    out::error(&format!("{}: {}", args.order.text(), answer["error"].as_str().unwrap_or("refused")));
    Ok(ExitCode::from(1))
}
