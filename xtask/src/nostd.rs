//! The crates that run in the loop must build without std, each alone, and give the same bits there.
//!
//! Alone, because in a build of the whole workspace another member switches std features of shared dependencies on, and an inherent
//! method of std then compiles unnoticed in a `no_std` crate.

use crate::shell::{answer, cargo, program, run, target};

/// Crates and the flags that build them without std.
const CRATES: [&str; 3] = ["-p pkm-dyn --no-default-features", "-p pkm-ctrl", "-p pkm-hal --no-default-features --features conformance"];

/// Targets that have no std at all; checked where rustup has them.
const BARE_METAL: [&str; 2] = ["thumbv7em-none-eabihf", "x86_64-unknown-none"];

const PROOF: &str = "tools/nostd-proof/Cargo.toml";

/// Builds each crate alone, runs the proof program, checks the bare-metal targets that are installed.
pub(crate) fn check() -> Result<(), String> {
    for name in CRATES {
        run(&mut cargo(&format!("build --locked {name}")))?;
    }
    proof()?;
    let installed = answer(&mut program("rustup", &["target", "list", "--installed"])).unwrap_or_default();
    for triple in BARE_METAL {
        if !installed.lines().any(|line| line.trim() == triple) {
            println!("   not run: target {triple} not installed");
            continue;
        }
        for name in CRATES {
            run(&mut cargo(&format!("check --locked --target {triple} {name}")))?;
        }
    }
    Ok(())
}

/// The proof program has its own entry point and system calls, written for one platform.
fn proof() -> Result<(), String> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        println!("   not run: {PROOF} is for x86-64 Linux");
        return Ok(());
    }
    // A folder of its own: it is its own workspace, with its own profiles.
    let folder = target().join("nostd-proof");
    for arguments in ["test --locked --lib", "run --locked"] {
        run(cargo(&format!("{arguments} --manifest-path {PROOF}")).env("CARGO_TARGET_DIR", &folder))?;
    }
    println!("   the same bits with std and without");
    Ok(())
}
