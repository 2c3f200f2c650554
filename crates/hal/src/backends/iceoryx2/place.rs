//! The directory where both sides meet: private, with a lock for each side and the number of the service each of them owns.

extern crate alloc;

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::fmt;
use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use crate::checksum::{FNV_START, fnv1a};

/// Longest file that is read here `[bytes]`.
const MAX_BYTES: u64 = 4096;

/// Where the library keeps what both sides see.
const SHARED_MEMORY: &str = "/dev/shm";

/// Free room there with which a side begins: several times what both take `[bytes]`.
const ROOM: u64 = 1 << 19;

/// Why a side cannot begin.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SharedError {
    /// The operating system refused a file or directory.
    #[error("{path}: {problem}")]
    File {
        /// Which.
        path: String,
        /// In its words.
        problem: String,
    },
    /// The directory is not private.
    #[error("{path}: {problem} (must be a directory of uid {uid} with mode 0700: others could command the robot)")]
    NotPrivate {
        /// Which.
        path: String,
        /// What is wrong.
        problem: String,
        /// Who must own it.
        uid: u32,
    },
    /// A file of this place in shared memory is not ours.
    #[error("{path}: belongs to uid {found} (must be uid {uid}: others could command the robot; only they or root can remove it)")]
    Foreign {
        /// Which.
        path: String,
        /// Who owns it.
        found: u32,
        /// Who must own it.
        uid: u32,
    },
    /// Shared memory is full.
    #[error("{path}: {free} bytes are free ({needed} are needed): remove what nobody uses there, or `mount -o remount,size=64m {path}`")]
    Full {
        /// Where.
        path: String,
        /// What is free there.
        free: u64,
        /// What must be.
        needed: u64,
    },
    /// Somebody else has this role already.
    #[error("{path}: a {role} runs already, process {pid}")]
    Busy {
        /// The lock.
        path: String,
        /// Which role.
        role: Role,
        /// Its process, 0 where it has not said yet.
        pid: u32,
    },
    /// The library failed, and what mends it did not help.
    #[error("service {service}: {problem}; stop both sides, remove {root} and /dev/shm/{prefix}*, start again")]
    Service {
        /// Which service.
        service: String,
        /// The library's words.
        problem: String,
        /// Where its files are.
        root: String,
        /// What its files in shared memory begin with.
        prefix: String,
    },
}

/// A side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Commands the robot.
    Daemon,
    /// Is the robot.
    Driver,
}

impl Role {
    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Daemon => Self::Driver,
            Self::Driver => Self::Daemon,
        }
    }

    /// Its name in files and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Daemon => "daemon",
            Self::Driver => "driver",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A private directory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    dir: PathBuf,
}

fn failed(path: &Path, problem: &io::Error) -> SharedError {
    SharedError::File { path: path.display().to_string(), problem: problem.to_string() }
}

impl Place {
    /// The directory at `dir`, made with mode 0700 where there is none.
    ///
    /// # Errors
    /// It cannot be made, is no directory, belongs to somebody else, or others may look into it.
    pub fn try_new(dir: &Path) -> Result<Self, SharedError> {
        match DirBuilder::new().mode(0o700).create(dir) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(failed(dir, &e)),
            _ => {}
        }
        // Not followed: a link could lead into a directory of somebody else's choice.
        let about = fs::symlink_metadata(dir).map_err(|e| failed(dir, &e))?;
        let uid = rustix::process::geteuid().as_raw();
        let problem = if !about.is_dir() {
            "is no directory".to_string()
        } else if about.uid() != uid {
            format!("belongs to uid {}", about.uid())
        } else if about.mode() & 0o077 != 0 {
            format!("has mode {:04o}", about.mode() & 0o7777)
        } else {
            let dir = fs::canonicalize(dir).map_err(|e| failed(dir, &e))?;
            return Ok(Self { dir });
        };
        Err(SharedError::NotPrivate { path: dir.display().to_string(), problem, uid })
    }

    /// The directory.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Takes a role, for as long as the lock lives.
    ///
    /// # Errors
    /// Somebody has it, in no time; the lock's file cannot be opened.
    pub fn lock(&self, role: Role) -> Result<Lock, SharedError> {
        let path = self.dir.join(format!("{role}.lock"));
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false).mode(0o600);
        let mut file = options.open(&path).map_err(|e| failed(&path, &e))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let pid = first_number(&text_of(&mut file).unwrap_or_default());
                return Err(SharedError::Busy { path: path.display().to_string(), role, pid });
            }
            Err(TryLockError::Error(e)) => return Err(failed(&path, &e)),
        }
        let said = file.set_len(0).and_then(|()| file.rewind()).and_then(|()| writeln!(file, "{}", std::process::id()));
        said.map_err(|e| failed(&path, &e))?;
        Ok(Lock { _file: file })
    }

    /// What files of the library in shared memory begin with: another directory, another uid, another name.
    #[must_use]
    pub fn prefix(&self) -> String {
        let hash = fnv1a(FNV_START, &self.dir.display().to_string());
        format!("pkm1_{hash:016x}_")
    }

    /// Where the library's other files are.
    #[must_use]
    pub fn root(&self) -> PathBuf {
        self.dir.join("iox2")
    }

    fn number_path(&self, role: Role) -> PathBuf {
        self.dir.join(format!("{role}.service"))
    }

    /// Number of the service that `role` owns, and the layout of its frames; none before its first start.
    pub(super) fn number(&self, role: Role) -> Option<(u32, u64)> {
        let mut file = File::open(self.number_path(role)).ok()?;
        let text = text_of(&mut file).ok()?;
        let mut words = text.split_whitespace();
        Some((words.next()?.parse().ok()?, u64::from_str_radix(words.next()?, 16).ok()?))
    }

    /// Says which service `role` owns; whole or not at all.
    pub(super) fn set_number(&self, role: Role, number: u32, layout: u64) -> Result<(), SharedError> {
        let (path, part) = (self.number_path(role), self.dir.join(format!("{role}.service.part")));
        let write = || {
            let mut file = OpenOptions::new().write(true).create(true).truncate(true).mode(0o600).open(&part)?;
            writeln!(file, "{number} {layout:016x}")?;
            fs::rename(&part, &path)
        };
        write().map_err(|e| failed(&path, &e))
    }

    /// Removes every file of the library that belongs to this place. Nobody may be using them.
    pub(super) fn sweep(&self) {
        // What cannot be removed shows when the service is made once more.
        let _ = fs::remove_dir_all(self.root());
        for path in self.in_shared_memory() {
            let _ = fs::remove_file(path);
        }
    }

    /// Files of the library in shared memory that belong to this place.
    #[must_use]
    pub fn in_shared_memory(&self) -> Vec<PathBuf> {
        let prefix = self.prefix();
        let Ok(entries) = fs::read_dir(SHARED_MEMORY) else { return Vec::new() };
        let ours = entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
        ours.map(|entry| entry.path()).collect()
    }

    /// Whether there is room for what the library is about to make: a page that cannot be had where it is first touched is the end of the
    /// process, without a word.
    pub(super) fn has_room(&self) -> Result<(), SharedError> {
        let Ok(about) = rustix::fs::statvfs(SHARED_MEMORY) else { return Ok(()) };
        let free = about.f_bavail.saturating_mul(about.f_frsize);
        // Without blocks it has no bounds of its own.
        if about.f_blocks == 0 || free >= ROOM {
            return Ok(());
        }
        Err(SharedError::Full { path: SHARED_MEMORY.to_string(), free, needed: ROOM })
    }

    /// Gets every page of its files in shared memory, so that none is missing in operation, however full it becomes.
    pub(super) fn keep_pages(&self) -> Result<(), SharedError> {
        for path in self.in_shared_memory() {
            // It may have gone meanwhile.
            let Ok(file) = OpenOptions::new().write(true).open(&path) else { continue };
            let length = file.metadata().map_or(0, |about| about.len());
            let kept = rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::KEEP_SIZE, 0, length);
            if kept == Err(rustix::io::Errno::NOSPC) {
                return Err(SharedError::Full { path: SHARED_MEMORY.to_string(), free: 0, needed: length });
            }
        }
        Ok(())
    }

    /// Shuts others out of the files in shared memory: the library leaves one of its own open to everybody, by intention.
    ///
    /// # Errors
    /// One of them is somebody else's, who knew its name.
    pub(super) fn shut(&self) -> Result<(), SharedError> {
        let uid = rustix::process::geteuid().as_raw();
        for path in self.in_shared_memory() {
            // It may have gone meanwhile: that is as good.
            let Ok(about) = fs::symlink_metadata(&path) else { continue };
            if about.uid() != uid {
                return Err(SharedError::Foreign { path: path.display().to_string(), found: about.uid(), uid });
            }
            if about.mode() & 0o077 != 0 {
                match fs::set_permissions(&path, fs::Permissions::from_mode(0o600)) {
                    Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(failed(&path, &e)),
                    _ => {}
                }
            }
        }
        Ok(())
    }
}

/// A role that is held.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

fn text_of(file: &mut File) -> io::Result<String> {
    let mut text = String::new();
    file.take(MAX_BYTES).read_to_string(&mut text)?;
    Ok(text)
}

fn first_number(text: &str) -> u32 {
    text.split_whitespace().next().and_then(|word| word.parse().ok()).unwrap_or(0)
}
