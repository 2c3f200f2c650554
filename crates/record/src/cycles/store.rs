//! Where files go: a folder, or in tests anything that can refuse.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A file being written.
pub trait Stored: Write + Send {
    /// Makes sure that what was written is on the medium.
    ///
    /// # Errors
    /// What the system says.
    fn sync(&mut self) -> io::Result<()>;
}

impl Stored for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
}

/// A place for files.
pub trait Store: Send {
    /// Makes a new file; one that is there already is an error of kind [`io::ErrorKind::AlreadyExists`].
    ///
    /// # Errors
    /// What the system says.
    fn create(&mut self, name: &str) -> io::Result<Box<dyn Stored>>;

    /// Removes a file that could not be begun.
    fn discard(&mut self, name: &str);

    /// What a file is called in messages.
    fn display(&self, name: &str) -> String;
}

/// A folder of the file system; it is made again when it is gone.
#[derive(Debug, Clone)]
pub struct Folder {
    path: PathBuf,
}

impl Folder {
    /// The folder at `path`.
    #[must_use]
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_path_buf() }
    }
}

impl Store for Folder {
    fn create(&mut self, name: &str) -> io::Result<Box<dyn Stored>> {
        // A file of that name would look as if ours were there already.
        let not_a_folder = |e: io::Error| if self.path.is_file() { io::ErrorKind::NotADirectory.into() } else { e };
        fs::create_dir_all(&self.path).map_err(not_a_folder)?;
        Ok(Box::new(OpenOptions::new().write(true).create_new(true).open(self.path.join(name))?))
    }

    fn discard(&mut self, name: &str) {
        // The error that matters is the one that led here.
        let _ = fs::remove_file(self.path.join(name));
    }

    fn display(&self, name: &str) -> String {
        self.path.join(name).display().to_string()
    }
}
