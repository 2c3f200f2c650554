//! One drive on the segment: the memory that datagrams see, and the drive behind it.

use alloc::collections::BTreeMap;

use pkm_hal::backends::cia402::DriveOutputs;

use super::sii::{DATA_IN, DATA_OUT, MAILBOX, MAILBOX_IN, MAILBOX_OUT, words};
use crate::drive::Drive;

/// Registers (ETG.1000.4): address of the station, control and state of the application with the reason of a refusal, EEPROM.
const STATION: usize = 0x10;
const CONTROL: usize = 0x120;
const STATE: usize = 0x130;
const REASON: usize = 0x134;
const SII_CONTROL: usize = 0x502;
const SII_DATA: usize = 0x508;

/// Where FMMUs and sync managers are configured.
const FMMU: usize = 0x600;
const SYNC: usize = 0x800;

/// Bit of a mailbox's state: it is full.
const FULL: u8 = 8;

/// States of the application.
pub(crate) const INIT: u8 = 1;
pub(crate) const PRE_OP: u8 = 2;
pub(crate) const SAFE_OP: u8 = 4;
pub(crate) const OP: u8 = 8;

/// A drive, and what can be wrong with it.
pub(crate) struct Device {
    memory: Vec<u8>,
    sii: Vec<u16>,
    /// Objects by index and subindex.
    pub(crate) objects: BTreeMap<(u16, u8), u32>,
    pub(crate) drive: Drive,
    /// It is off the bus: frames pass it by.
    pub(crate) is_off: bool,
    /// Its interface answers, its firmware stands still.
    pub(crate) is_frozen: bool,
    /// Index of an object that it refuses to change.
    pub(crate) refuses: Option<u16>,
    /// Process data came since it is safe.
    has_data: bool,
    /// It was asked for operation and waits for data.
    is_asked: bool,
}

impl Device {
    pub(crate) fn new() -> Self {
        // A profile of drives; lists that are not those of the driver: controlword and target position, statusword.
        let objects = [
            ((0x1000, 0), 0x0002_0192),
            ((0x1c12, 0), 1),
            ((0x1c12, 1), 0x1600),
            ((0x1c13, 0), 1),
            ((0x1c13, 1), 0x1a00),
            ((0x1600, 0), 2),
            ((0x1600, 1), 0x6040_0010),
            ((0x1600, 2), 0x607a_0020),
            ((0x1a00, 0), 1),
            ((0x1a00, 1), 0x6041_0010),
            ((0x6060, 0), 8),
        ];
        let mut memory = vec![0; 0x2000];
        (memory[STATE], memory[0x110]) = (INIT, 0x31);
        let mut drive = Drive::NEW;
        drive.position = 1000;
        let (is_off, is_frozen, refuses, has_data, is_asked) = (false, false, None, false, false);
        Self { memory, sii: words(), objects: objects.into(), drive, is_off, is_frozen, refuses, has_data, is_asked }
    }

    /// State of the application.
    pub(crate) fn state(&self) -> u8 {
        self.memory[STATE] & 0x0f
    }

    /// Leaves operation by itself, as after a watchdog of its own (1Bh).
    pub(crate) fn fall(&mut self) {
        (self.memory[STATE], self.memory[REASON], self.is_asked) = (SAFE_OP | 0x10, 0x1b, false);
    }

    fn word(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.memory[at], self.memory[at + 1]])
    }

    /// A datagram as it passes: head, data, working counter.
    pub(super) fn pass(&mut self, datagram: &mut [u8]) {
        if self.is_off {
            return;
        }
        let (command, at) = (datagram[0], u16::from_le_bytes([datagram[4], datagram[5]]));
        let address = u16::from_le_bytes([datagram[2], datagram[3]]);
        let last = datagram.len() - 2;
        let is_meant = match command {
            1 | 2 => address == 0,
            4 | 5 => address == self.word(STATION),
            7 | 8 => true,
            10..=12 => {
                let logical = u32::from(at) << 16 | u32::from(address);
                let count = self.logical(command, logical, &mut datagram[10..last]);
                return added(datagram, count);
            }
            other => panic!("no command {other}"),
        };
        if [1, 2, 7, 8].contains(&command) {
            datagram[2..4].copy_from_slice(&address.wrapping_add(1).to_le_bytes());
        }
        if is_meant {
            let data = &mut datagram[10..last];
            let is_done = if [2, 5, 8].contains(&command) { self.written(usize::from(at), data) } else { self.read(usize::from(at), data) };
            added(datagram, u16::from(is_done));
        }
    }

    /// Reads registers or memory; a mailbox that is empty is not read.
    fn read(&mut self, at: usize, data: &mut [u8]) -> bool {
        let is_mailbox = at == usize::from(MAILBOX_IN);
        if is_mailbox && self.memory[SYNC + 8 + 5] & FULL == 0 {
            return false;
        }
        // Of several devices, what is read is combined.
        data.iter_mut().zip(&self.memory[at..]).for_each(|(out, byte)| *out |= byte);
        if is_mailbox {
            self.memory[SYNC + 8 + 5] &= !FULL;
        }
        true
    }

    fn written(&mut self, at: usize, data: &[u8]) -> bool {
        self.memory[at..at + data.len()].copy_from_slice(data);
        match at {
            CONTROL => self.requested(data[0]),
            SII_CONTROL if data[1] & 1 != 0 => {
                let from = usize::from(u16::from_le_bytes([data[2], data[3]]));
                for k in 0..2 {
                    let word = self.sii.get(from + k).copied().unwrap_or(0xffff);
                    self.memory[SII_DATA + 2 * k..SII_DATA + 2 * k + 2].copy_from_slice(&word.to_le_bytes());
                }
                // Neither busy nor in error, four bytes at a time.
                self.memory[SII_CONTROL..SII_CONTROL + 2].fill(0);
            }
            at if at == usize::from(MAILBOX_OUT) => self.mail(data),
            _ => {}
        }
        true
    }

    /// A change of state that was asked for, and what it takes.
    fn requested(&mut self, wanted: u8) {
        let (now, length) = (self.state(), |manager: usize| usize::from(self.word(SYNC + 8 * manager + 2)));
        let is_open = |manager: usize| self.memory[SYNC + 8 * manager + 6] & 1 == 1;
        let refused = match wanted & 0x0f {
            // Without mailboxes there is no talk.
            PRE_OP if now == INIT && !(is_open(0) && is_open(1)) => Some(0x16),
            // Lengths of process data are those of the lists.
            SAFE_OP if now == PRE_OP && length(2) != self.length(0x1c12) => Some(0x1d),
            SAFE_OP if now == PRE_OP && length(3) != self.length(0x1c13) => Some(0x1e),
            OP if now != SAFE_OP => Some(0x11),
            _ => None,
        };
        if let Some(reason) = refused {
            (self.memory[STATE], self.memory[REASON]) = (now | 0x10, reason);
            return;
        }
        self.is_asked = wanted & 0x0f == OP;
        if !self.is_asked {
            (self.memory[STATE], self.has_data) = (wanted & 0x0f, false);
        }
    }

    /// Objects of process data, as the assignment and its lists say: index and bytes.
    fn entries(&self, assignment: u16) -> Vec<(u16, usize)> {
        let object = |index: u16, sub: u8| self.objects.get(&(index, sub)).copied().unwrap_or(0);
        let count = |index: u16| u8::try_from(object(index, 0)).unwrap();
        let lists = (1..=count(assignment)).map(|k| u16::try_from(object(assignment, k)).unwrap());
        let of = |list: u16| (1..=count(list)).map(move |k| object(list, k));
        lists.flat_map(of).map(|entry| (u16::try_from(entry >> 16).unwrap(), (entry & 0xff) as usize / 8)).collect()
    }

    fn length(&self, assignment: u16) -> usize {
        self.entries(assignment).iter().map(|(_, bytes)| bytes).sum()
    }

    /// Process data through the FMMUs; how much the working counter grows.
    fn logical(&mut self, command: u8, logical: u32, data: &mut [u8]) -> u16 {
        let (mut count, is_safe) = (0, [SAFE_OP, OP].contains(&self.state()));
        for k in (0..4).filter(|_| is_safe) {
            let fmmu: [u8; 16] = self.memory[FMMU + 16 * k..FMMU + 16 * k + 16].try_into().unwrap();
            let start = u32::from_le_bytes([fmmu[0], fmmu[1], fmmu[2], fmmu[3]]);
            let length = usize::from(u16::from_le_bytes([fmmu[4], fmmu[5]]));
            let place = usize::from(u16::from_le_bytes([fmmu[8], fmmu[9]]));
            let Some(from) = start.checked_sub(logical).and_then(|from| usize::try_from(from).ok()) else { continue };
            if fmmu[12] & 1 == 0 || length == 0 || from + length > data.len() {
                continue;
            }
            let part = &mut data[from..from + length];
            if fmmu[11] == 2 && command != 10 {
                assert_eq!(place, usize::from(DATA_OUT));
                self.memory[place..place + length].copy_from_slice(part);
                count += 2;
                self.act();
            } else if fmmu[11] == 1 && command != 11 {
                assert_eq!(place, usize::from(DATA_IN));
                part.copy_from_slice(&self.memory[place..place + length]);
                count += 1;
            }
        }
        count
    }

    /// A cycle of the firmware: it acts on what it was sent when it is in operation, and says how it is.
    fn act(&mut self) {
        if self.is_frozen {
            return;
        }
        if self.is_asked && self.has_data {
            (self.memory[STATE], self.is_asked) = (OP, false);
        }
        self.has_data = true;
        let (mut at, mut sent) = (usize::from(DATA_OUT), BTreeMap::new());
        for (index, bytes) in self.entries(0x1c12) {
            let value = self.memory[at..at + bytes].iter().rev().fold(0_u32, |word, byte| word << 8 | u32::from(*byte));
            sent.insert(index, value);
            at += bytes;
        }
        let of = |index: u16| sent.get(&index).copied().unwrap_or(0).to_le_bytes();
        let ([c0, c1, ..], [t0, t1, ..], [mode, ..]) = (of(0x6040), of(0x6071), of(0x6060));
        let out = DriveOutputs { control: u16::from_le_bytes([c0, c1]), torque: i16::from_le_bytes([t0, t1]), mode: mode.cast_signed() };
        // Before the first word of a master there is no mode; outside operation nothing is followed.
        if self.state() == OP && out.mode != 0 {
            self.drive.cycle(&out);
        }
        let torque = i32::from(self.drive.torque);
        let mut at = usize::from(DATA_IN);
        for (index, bytes) in self.entries(0x1c13) {
            let value = match index {
                0x6041 => i32::from(self.drive.status()),
                0x6064 => self.drive.position,
                // A tick a cycle of a millisecond is a thousand a second.
                0x606c => 1000 * torque,
                0x6077 => torque,
                other => panic!("no object {other:04x} to send"),
            };
            self.memory[at..at + bytes].copy_from_slice(&value.to_le_bytes()[..bytes]);
            at += bytes;
        }
    }

    /// A letter, and the answer to it: SDOs of four bytes at most.
    fn mail(&mut self, letter: &[u8]) {
        assert_eq!((letter[5] & 0x0f, letter[7] >> 4), (3, 2), "CANopen over EtherCAT, a request");
        let (command, index, sub) = (letter[8] >> 5, u16::from_le_bytes([letter[9], letter[10]]), letter[11]);
        let value = u32::from_le_bytes([letter[12], letter[13], letter[14], letter[15]]);
        let (answer, data) = match command {
            1 if self.refuses == Some(index) || self.is_locked(index, sub) => (0x80, 0x0601_0002),
            1 => {
                let unused = u32::from(letter[8] >> 2 & 3);
                self.objects.insert((index, sub), value & (u32::MAX >> (8 * unused)));
                (0x60, 0)
            }
            2 => match self.objects.get(&(index, sub)) {
                // Four bytes at once, whatever the object.
                Some(value) => (0x43, *value),
                None => (0x80, 0x0602_0000),
            },
            other => panic!("no SDO command {other}"),
        };
        let mut out = vec![0; usize::from(MAILBOX)];
        (out[0], out[5], out[7], out[8]) = (10, letter[5], 0x30, answer);
        out[9..12].copy_from_slice(&letter[9..12]);
        out[12..16].copy_from_slice(&data.to_le_bytes());
        let at = usize::from(MAILBOX_IN);
        self.memory[at..at + out.len()].copy_from_slice(&out);
        self.memory[SYNC + 8 + 5] |= FULL;
    }

    /// Lists that count, and those of a drive that is past talking, are not changed.
    fn is_locked(&self, index: u16, sub: u8) -> bool {
        let is_list = [0x1600, 0x1a00, 0x1c12, 0x1c13].contains(&index);
        let counts = sub != 0 && self.objects.get(&(index, 0)).is_some_and(|n| *n != 0);
        let assignment = if index & 0xff00 == 0x1600 { 0x1c12 } else { 0x1c13 };
        let is_assigned = index < 0x1c00 && self.objects.get(&(assignment, 0)).is_some_and(|n| *n != 0);
        is_list && (self.state() != PRE_OP || counts || is_assigned)
    }
}

/// The working counter, which comes last.
fn added(datagram: &mut [u8], count: u16) {
    let at = datagram.len() - 2;
    let sum = u16::from_le_bytes([datagram[at], datagram[at + 1]]) + count;
    datagram[at..].copy_from_slice(&sum.to_le_bytes());
}
