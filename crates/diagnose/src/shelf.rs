//! Long series that wait to be used: in memory as long as there is room, beyond that in a temporary file that has no name, where a folder for
//! one was given.
//!
//! What is read is to the bit what was put, wherever it lay, so how much room there is changes no verdict.

use alloc::collections::BTreeMap;
use alloc::sync::Arc;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Numbers of a series that is taken sample by sample that lie in memory before they are put away.
const CHUNK: usize = 1 << 13;

/// Bytes of a number.
const WIDE: u64 = 8;

/// Where the series of one diagnosis lie; copies are the same shelf.
#[derive(Debug, Clone)]
pub(crate) struct Shelf(Arc<Mutex<State>>);

#[derive(Debug)]
struct State {
    /// Numbers that may still be kept in memory.
    room: usize,
    folder: PathBuf,
    file: Option<File>,
    /// End of the file, in numbers.
    end: u64,
    /// Places in the file whose series are gone: where, by length.
    free: BTreeMap<usize, Vec<u64>>,
    /// What the file system refused first.
    refused: Option<String>,
}

impl Default for Shelf {
    /// Everything stays in memory.
    fn default() -> Self {
        Self::with_room(usize::MAX, PathBuf::new())
    }
}

impl Shelf {
    /// Keeps `room` numbers in memory, and what is beyond in a temporary file in `folder`.
    pub(crate) fn with_room(room: usize, folder: PathBuf) -> Self {
        Self(Arc::new(Mutex::new(State { room, folder, file: None, end: 0, free: BTreeMap::new(), refused: None })))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a series away.
    pub(crate) fn put(&self, x: Vec<f64>) -> Stored {
        let mut state = self.state();
        let n = x.len();
        if n > state.room
            && let Some(at) = state.write(&x)
        {
            return Stored { place: Place::File(at), n, shelf: self.clone() };
        }
        state.room = state.room.saturating_sub(n);
        Stored { place: Place::Memory(x), n, shelf: self.clone() }
    }

    /// What the file system refused to give back; nothing while all is well.
    pub(crate) fn refused(&self) -> Option<String> {
        self.state().refused.clone()
    }

    /// Bytes that lie in the file.
    pub(crate) fn on_file(&self) -> u64 {
        WIDE * self.state().end
    }
}

impl State {
    /// Where in the file the numbers went; nothing where no file can be had: they stay in memory then.
    fn write(&mut self, x: &[f64]) -> Option<u64> {
        if self.file.is_none() {
            let made = tempfile::tempfile_in(&self.folder);
            self.file = made.inspect_err(|e| tracing::warn!("no temporary file, series stay in memory: {e}")).ok();
        }
        let file = self.file.as_mut()?;
        let at = self.free.get_mut(&x.len()).and_then(Vec::pop);
        let to = at.unwrap_or(self.end);
        let bytes: Vec<u8> = x.iter().flat_map(|x| x.to_le_bytes()).collect();
        let written = file.seek(SeekFrom::Start(WIDE * to)).and_then(|_| file.write_all(&bytes));
        if let Err(e) = written {
            tracing::warn!("the temporary file takes no more, series stay in memory: {e}");
            return None;
        }
        if at.is_none() {
            self.end += x.len() as u64;
        }
        Some(to)
    }

    fn read(&mut self, at: u64, n: usize) -> std::io::Result<Vec<f64>> {
        let file = self.file.as_mut().ok_or(std::io::ErrorKind::NotFound)?;
        let mut bytes = vec![0_u8; n * size_of::<f64>()];
        file.seek(SeekFrom::Start(WIDE * at))?;
        file.read_exact(&mut bytes)?;
        let (numbers, _) = bytes.as_chunks::<{ size_of::<f64>() }>();
        Ok(numbers.iter().map(|b| f64::from_le_bytes(*b)).collect())
    }
}

#[derive(Debug)]
enum Place {
    Memory(Vec<f64>),
    /// Offset in numbers.
    File(u64),
}

/// A series that was put away.
#[derive(Debug)]
pub(crate) struct Stored {
    place: Place,
    n: usize,
    shelf: Shelf,
}

impl Stored {
    /// The series.
    ///
    /// Where the file system refuses to give back what it took, zeros: [`Shelf::refused`] says so, and a diagnosis then ends in an error.
    pub(crate) fn read(&self) -> Vec<f64> {
        match &self.place {
            Place::Memory(x) => x.clone(),
            Place::File(at) => {
                let mut state = self.shelf.state();
                state.read(*at, self.n).unwrap_or_else(|e| {
                    state.refused.get_or_insert_with(|| e.to_string());
                    vec![0.0; self.n]
                })
            }
        }
    }
}

impl Clone for Stored {
    fn clone(&self) -> Self {
        self.shelf.put(self.read())
    }
}

impl Drop for Stored {
    fn drop(&mut self) {
        let mut state = self.shelf.state();
        match self.place {
            Place::Memory(_) => state.room = state.room.saturating_add(self.n),
            Place::File(at) => state.free.entry(self.n).or_default().push(at),
        }
    }
}

/// A series that is taken sample by sample.
#[derive(Debug, Clone)]
pub(crate) struct Tape {
    whole: Vec<Stored>,
    open: Vec<f64>,
    shelf: Shelf,
    top: f64,
    square: f64,
    is_cleared: bool,
}

impl Tape {
    /// Nothing yet, on `shelf`.
    pub(crate) fn new(shelf: &Shelf) -> Self {
        Self { whole: Vec::new(), open: Vec::new(), shelf: shelf.clone(), top: 0.0, square: 0.0, is_cleared: false }
    }

    /// Takes the next sample.
    pub(crate) fn push(&mut self, x: f64) {
        self.top = self.top.max(x.abs());
        self.square += x * x;
        self.open.push(x);
        if self.open.len() == CHUNK {
            self.whole.push(self.shelf.put(core::mem::take(&mut self.open)));
        }
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        CHUNK * self.whole.len() + self.open.len()
    }

    /// All samples.
    pub(crate) fn read(&self) -> Vec<f64> {
        let mut out = Vec::with_capacity(self.len());
        self.whole.iter().for_each(|part| out.extend(part.read()));
        out.extend(&self.open);
        if self.is_cleared {
            out.fill(0.0);
        }
        out
    }

    /// Makes all samples so far zeros.
    pub(crate) fn clear(&mut self) {
        (self.top, self.square, self.is_cleared) = (0.0, 0.0, true);
    }

    /// Largest size of a sample.
    pub(crate) fn top(&self) -> f64 {
        self.top
    }

    /// Sum of the samples' squares.
    pub(crate) fn square(&self) -> f64 {
        self.square
    }

    /// Lets go of the samples; how large they were stays known.
    pub(crate) fn shed(&mut self) {
        (self.whole, self.open) = (Vec::new(), Vec::new());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(n: usize, by: f64) -> Vec<f64> {
        (0..n).map(|i| by * i as f64 - 1e-300).collect()
    }

    fn bits(x: &[f64]) -> Vec<u64> {
        x.iter().map(|x| x.to_bits()).collect()
    }

    #[test]
    fn what_lies_in_the_file_comes_back_to_the_bit_and_its_place_is_used_again() {
        let shelf = Shelf::with_room(100, std::env::temp_dir());
        let (kept, filed) = (shelf.put(series(80, 0.1)), shelf.put(series(50, 0.3)));
        assert_eq!(shelf.on_file(), 400);
        assert_eq!((bits(&kept.read()), bits(&filed.read())), (bits(&series(80, 0.1)), bits(&series(50, 0.3))));
        drop(filed);
        let next = shelf.put(series(50, 0.7));
        assert_eq!((shelf.on_file(), bits(&next.read())), (400, bits(&series(50, 0.7))));
        drop(kept);
        let small = shelf.put(series(99, 0.9));
        assert_eq!((shelf.on_file(), small.read().len(), shelf.refused()), (400, 99, None), "room that is given back is room again");
    }

    #[test]
    fn a_tape_is_what_was_pushed_wherever_its_chunks_lie() {
        let x = series(3 * CHUNK + 17, 1e-3);
        for room in [0, CHUNK, usize::MAX] {
            let shelf = Shelf::with_room(room, std::env::temp_dir());
            let mut tape = Tape::new(&shelf);
            x.iter().for_each(|x| tape.push(*x));
            assert_eq!(bits(&tape.read()), bits(&x));
            assert!((tape.top() - x[x.len() - 1]).abs() <= 0.0);
            let square: f64 = x.iter().map(|x| x * x).sum();
            assert!((tape.square() - square).abs() < 1e-12 * square);
            tape.clear();
            assert_eq!(tape.read(), vec![0.0; x.len()]);
        }
    }

    #[test]
    fn a_file_that_is_gone_is_told_and_no_panic() {
        let shelf = Shelf::with_room(0, std::env::temp_dir());
        let filed = shelf.put(series(10, 1.0));
        if let Some(file) = &shelf.state().file {
            file.set_len(8).expect("a file can be cut");
        }
        assert_eq!((filed.read(), shelf.refused().is_some()), (vec![0.0; 10], true));
    }

    #[test]
    fn without_a_folder_or_with_one_that_is_not_there_series_stay_in_memory() {
        for shelf in [Shelf::default(), Shelf::with_room(0, PathBuf::from("no such folder"))] {
            let stored = shelf.put(series(50, 0.2));
            assert_eq!((bits(&stored.read()), shelf.on_file(), shelf.refused()), (bits(&series(50, 0.2)), 0, None));
        }
    }
}
