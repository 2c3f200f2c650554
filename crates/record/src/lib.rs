//! Recordings at the edge: CSV and MCAP files in, [`Recording`]s out, and back.
//!
//! Knows file formats only. What a signal means is `pkm-ident`'s business, whether it is good enough `pkm-diagnose`'s.
//! Files come from anywhere: nothing here panics on them, and no length read from a file is believed before it is checked.

extern crate alloc;

mod csv;
pub mod cycles;
mod error;
mod mcap;
mod meta;

use alloc::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

pub use cycles::{Control, ControlStep};
pub use error::{ReadError, WriteError};
use pkm_ident::Recording;

/// How to read a file; the default reads whole files only.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Topic of the joint states in an MCAP file; without it `/joint_states`, or the only one there is. A CSV file has no topics.
    pub topic: Option<String>,
    /// Returns what is complete of a damaged MCAP file instead of an error; the recording says so under `recovered` in its metadata.
    pub recover: bool,
}

/// A file carried inside an MCAP file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// File name, such as `robot.toml`.
    pub name: String,
    /// Media type, such as `application/toml`.
    pub media_type: String,
    /// Content.
    pub bytes: Vec<u8>,
}

/// What a written file carries besides the recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Attachments {
    /// Files; CSV has no place for them and leaves them out.
    pub files: Vec<Attachment>,
    /// Further metadata keys, such as a configuration hash; on reading they are in `Meta::other`.
    pub keys: BTreeMap<String, String>,
    /// What wrote it, where that says more of itself than the version of this crate: the `version` of the file, which reading leaves out.
    pub version: Option<String>,
    /// Steps of the controller, in order of time; CSV has no place for them. They are read by [`read_controls`].
    pub controls: Vec<ControlStep>,
}

impl Attachments {
    /// What wrote the file.
    fn version(&self) -> &str {
        self.version.as_deref().unwrap_or(env!("CARGO_PKG_VERSION"))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Csv,
    Mcap,
}

impl Format {
    fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?;
        if extension.eq_ignore_ascii_case("csv") {
            Some(Self::Csv)
        } else if extension.eq_ignore_ascii_case("mcap") {
            Some(Self::Mcap)
        } else {
            None
        }
    }
}

/// Reads a recording from a `.csv` or `.mcap` file, or from the folder of a rosbag2 with one `.mcap` file; its name is the path as given.
///
/// ```
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("A.csv");
/// std::fs::write(&path, "# tau = measured\nt,q.leg_1,tau.leg_1\n0.00,0.1,2.5\n0.01,0.2,\n").unwrap();
/// let recording = pkm_record::read(&path, &pkm_record::ReadOptions::default()).unwrap();
/// assert_eq!(recording.signal("q.leg_1").unwrap(), [0.1, 0.2]);
/// assert!(recording.signal("tau.leg_1").unwrap()[1].is_nan());
/// ```
///
/// # Errors
/// Says in one line what is wrong where. A damaged MCAP file is an error unless `options.recover` is set.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Recording, ReadError> {
    let file = path.display().to_string();
    read_source(&file, open(path, &file)?, options)
}

/// As [`read`] from memory; `name` says what kind of file it is, and errors call it so.
///
/// # Errors
/// As [`read`].
pub fn read_bytes(name: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Recording, ReadError> {
    let file = name.display().to_string();
    read_source(&file, in_memory(name, &file, bytes)?, options)
}

fn read_source(file: &str, mut source: Source<'_>, options: &ReadOptions) -> Result<Recording, ReadError> {
    // Content before extension: an MCAP file under another name would be reported as a broken table.
    match source.format {
        Format::Mcap => mcap::read(file, source.reader, source.length, options),
        Format::Csv => {
            let mut bytes = Vec::new();
            source.reader.read_to_end(&mut bytes).map_err(|e| io_error(file, &e))?;
            csv::parse(file, &bytes)
        }
    }
}

/// Reads the files carried inside an MCAP file, those above 64 MiB left out; a CSV file has none.
///
/// # Errors
/// As [`read`].
pub fn read_attachments(path: &Path, options: &ReadOptions) -> Result<Attachments, ReadError> {
    let file = path.display().to_string();
    attachments_of(&file, open(path, &file)?, options)
}

/// As [`read_attachments`] from memory.
///
/// # Errors
/// As [`read`].
pub fn read_attachments_bytes(name: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Attachments, ReadError> {
    let file = name.display().to_string();
    attachments_of(&file, in_memory(name, &file, bytes)?, options)
}

fn attachments_of(file: &str, source: Source<'_>, options: &ReadOptions) -> Result<Attachments, ReadError> {
    match source.format {
        Format::Mcap => mcap::read_attachments(file, source.reader, source.length, options),
        Format::Csv => Ok(Attachments::default()),
    }
}

/// Reads the steps of the controller that an MCAP file holds, one after the other; a CSV file has none.
///
/// # Errors
/// As [`read`].
pub fn read_controls(path: &Path, options: &ReadOptions, each: &mut dyn FnMut(ControlStep)) -> Result<(), ReadError> {
    let file = path.display().to_string();
    controls_of(&file, open(path, &file)?, options, each)
}

/// As [`read_controls`] from memory.
///
/// # Errors
/// As [`read`].
pub fn read_controls_bytes(name: &Path, bytes: &[u8], options: &ReadOptions, each: &mut dyn FnMut(ControlStep)) -> Result<(), ReadError> {
    let file = name.display().to_string();
    controls_of(&file, in_memory(name, &file, bytes)?, options, each)
}

fn controls_of(file: &str, source: Source<'_>, options: &ReadOptions, each: &mut dyn FnMut(ControlStep)) -> Result<(), ReadError> {
    match source.format {
        Format::Mcap => mcap::read_controls(file, source.reader, source.length, options, each),
        Format::Csv => Ok(()),
    }
}

/// Writes a recording as `.csv` or `.mcap`; the file appears complete or not at all.
///
/// ```
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("A.mcap");
/// let mut recording = pkm_ident::Recording { time: vec![0.0, 0.001], ..Default::default() };
/// recording.signals.insert("q.leg_1".to_string(), vec![0.1, f64::NAN]);
/// pkm_record::write(&path, &recording, &pkm_record::Attachments::default()).unwrap();
/// assert_eq!(pkm_record::read(&path, &Default::default()).unwrap().time, recording.time);
/// ```
///
/// # Errors
/// If the extension is unknown, the recording cannot be represented, or the file system refuses.
pub fn write(path: &Path, recording: &Recording, attachments: &Attachments) -> Result<(), WriteError> {
    let file = path.display().to_string();
    let format = Format::of(path).ok_or_else(|| WriteError::UnknownFormat { file: file.clone() })?;
    check(&file, recording)?;
    let lines = meta::to_pairs(&file, &recording.meta, &attachments.keys)?;
    // In the same directory: a rename across file systems is a copy, and a copy can be seen half done.
    let directory = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let io = |e: std::io::Error| WriteError::Io { file: file.clone(), detail: e.to_string() };
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any other new file: the umask decides, not the privacy of temporary files.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut temporary = builder.prefix(".").suffix(".part").tempfile_in(directory).map_err(io)?;
    match format {
        Format::Csv => csv::write(temporary.as_file_mut(), recording, &lines).map_err(io)?,
        Format::Mcap => mcap::write(&file, temporary.as_file_mut(), recording, (lines, attachments))?,
    }
    temporary.as_file().sync_all().map_err(io)?;
    temporary.persist(path).map_err(|e| io(e.error))?;
    Ok(())
}

struct Source<'a> {
    reader: Box<dyn Read + 'a>,
    length: u64,
    format: Format,
}

/// A file that is in memory already.
fn in_memory<'a>(name: &Path, file: &str, bytes: &'a [u8]) -> Result<Source<'a>, ReadError> {
    let named = Format::of(name).ok_or_else(|| ReadError::UnknownFormat { file: file.to_string() })?;
    let format = if bytes.starts_with(mcap::MAGIC) { Format::Mcap } else { named };
    Ok(Source { reader: Box::new(bytes), length: bytes.len() as u64, format })
}

fn io_error(file: &str, error: &std::io::Error) -> ReadError {
    ReadError::Io { file: file.to_string(), detail: error.to_string() }
}

/// What a bag of ROS 2 is besides a file.
const DATABASE: &str = "db3";

/// The file meant by a path: the only MCAP file of a folder, as `ros2 bag record` leaves it, else the path itself.
fn file_of(path: &Path, file: &str) -> Result<PathBuf, ReadError> {
    let has = |path: &Path, wanted: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(wanted));
    if !path.is_dir() {
        return if has(path, DATABASE) { Err(ReadError::Sqlite { file: file.to_string() }) } else { Ok(path.to_path_buf()) };
    }
    let entries = std::fs::read_dir(path).map_err(|e| io_error(file, &e))?;
    let inside: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    let mut recordings = inside.iter().filter(|p| has(p, "mcap"));
    match (recordings.next(), recordings.count()) {
        (Some(only), 0) => Ok(only.clone()),
        (None, _) if inside.iter().any(|p| has(p, DATABASE)) => Err(ReadError::Sqlite { file: file.to_string() }),
        (first, others) => Err(ReadError::Folder { file: file.to_string(), found: others + usize::from(first.is_some()) }),
    }
}

fn open(path: &Path, file: &str) -> Result<Source<'static>, ReadError> {
    let path = file_of(path, file)?;
    let mut format = Format::of(&path).ok_or_else(|| ReadError::UnknownFormat { file: file.to_string() })?;
    let io = |e: std::io::Error| io_error(file, &e);
    let mut handle = File::open(path).map_err(io)?;
    let length = handle.metadata().map_err(io)?.len();
    let mut start = Vec::new();
    handle.by_ref().take(mcap::MAGIC.len() as u64).read_to_end(&mut start).map_err(io)?;
    if start == mcap::MAGIC {
        format = Format::Mcap;
    }
    Ok(Source { reader: Box::new(std::io::Cursor::new(start).chain(handle)), length, format })
}

/// What no format can carry, found before a byte is written.
fn check(file: &str, recording: &Recording) -> Result<(), WriteError> {
    let file = || file.to_string();
    if recording.is_empty() {
        return Err(WriteError::NoSamples { file: file() });
    }
    let mut before = f64::NEG_INFINITY;
    for (sample, &t) in recording.time.iter().enumerate() {
        if !t.is_finite() || t <= before {
            return Err(WriteError::Time { file: file(), sample, t, before });
        }
        before = t;
    }
    for (column, values) in &recording.signals {
        // A name must survive a header line: trimmed on reading, one line, and `t` is the time.
        if column.is_empty() || column == "t" || column.trim() != column || column.chars().any(char::is_control) {
            return Err(WriteError::ColumnName { file: file(), column: column.clone() });
        }
        if values.len() != recording.len() {
            let (found, wanted) = (values.len(), recording.len());
            return Err(WriteError::Length { file: file(), column: column.clone(), found, wanted });
        }
        if let Some(sample) = values.iter().position(|v| v.is_infinite()) {
            return Err(WriteError::NotFinite { file: file(), column: column.clone(), sample });
        }
    }
    Ok(())
}
