//! Plain CDR, the message encoding of ROS 2: each number aligned to its size, counted from after the 4-byte encapsulation header.

/// Whether an empty list of numbers is followed by the padding its elements would need.
///
/// DDS implementations disagree; who reads both ways needs no version of the writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum EmptyList {
    Bare,
    Padded,
}

/// Why a message is not what its schema says.
pub(crate) type Fault = &'static str;

const SHORT: Fault = "the message ends too early";

/// `std_msgs/msg/Header`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Header {
    /// `[ns]`.
    pub(crate) stamp_ns: i64,
}

/// `sensor_msgs/msg/JointState`; each list of numbers may be empty.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct JointState<'a> {
    pub(crate) header: Header,
    pub(crate) names: Vec<&'a str>,
    /// Position, velocity, effort.
    pub(crate) fields: [Vec<f64>; 3],
}

/// A message being read.
struct Reader<'a> {
    data: &'a [u8],
    at: usize,
    is_big: bool,
    empty: EmptyList,
}

impl<'a> Reader<'a> {
    fn new(message: &'a [u8], empty: EmptyList) -> Result<Self, Fault> {
        let (head, data) = message.split_first_chunk::<4>().ok_or(SHORT)?;
        let is_big = match head {
            [0, 0, ..] => true,
            [0, 1, ..] => false,
            _ => return Err("the encapsulation is not plain CDR"),
        };
        Ok(Self { data, at: 0, is_big, empty })
    }

    fn left(&self) -> usize {
        self.data.len().saturating_sub(self.at)
    }

    fn align(&mut self, to: usize) {
        self.at = self.at.next_multiple_of(to);
    }

    fn bytes(&mut self, n: usize) -> Result<&'a [u8], Fault> {
        let end = self.at.checked_add(n).ok_or(SHORT)?;
        let bytes = self.data.get(self.at..end).ok_or(SHORT)?;
        self.at = end;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        self.align(4);
        let bytes: [u8; 4] = self.bytes(4)?.try_into().map_err(|_| SHORT)?;
        Ok(if self.is_big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        self.align(8);
        let bytes: [u8; 8] = self.bytes(8)?.try_into().map_err(|_| SHORT)?;
        Ok(if self.is_big { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) })
    }

    fn count(&mut self) -> Result<usize, Fault> {
        usize::try_from(self.u32()?).map_err(|_| SHORT)
    }

    fn f64s(&mut self, n: usize) -> Result<Vec<f64>, Fault> {
        if n == 0 && self.empty == EmptyList::Bare {
            return Ok(Vec::new());
        }
        self.align(8);
        // The bytes are there before the list is made: a hostile count allocates nothing.
        let bytes = self.bytes(n.checked_mul(8).ok_or(SHORT)?)?;
        let number = if self.is_big { f64::from_be_bytes } else { f64::from_le_bytes };
        Ok(bytes.as_chunks::<8>().0.iter().map(|b| number(*b)).collect())
    }

    fn f64_list(&mut self) -> Result<Vec<f64>, Fault> {
        let n = self.count()?;
        self.f64s(n)
    }

    fn text(&mut self) -> Result<&'a str, Fault> {
        let n = self.count()?;
        let bytes = self.bytes(n)?;
        // The length counts the closing zero; some writers send an empty text without one.
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        core::str::from_utf8(bytes).map_err(|_| "a name is not UTF-8 text")
    }

    fn texts(&mut self) -> Result<Vec<&'a str>, Fault> {
        let n = self.count()?;
        if n > self.left() / 4 {
            return Err(SHORT);
        }
        (0..n).map(|_| self.text()).collect()
    }

    fn header(&mut self) -> Result<Header, Fault> {
        let sec = self.u32()?.cast_signed();
        let nanosec = self.u32()?;
        self.text()?;
        Ok(Header { stamp_ns: i64::from(sec) * 1_000_000_000 + i64::from(nanosec) })
    }

    fn joint_state(&mut self) -> Result<JointState<'a>, Fault> {
        let header = self.header()?;
        let names = self.texts()?;
        let fields = [self.f64_list()?, self.f64_list()?, self.f64_list()?];
        Ok(JointState { header, names, fields })
    }
}

/// Reads a `JointState`.
pub(crate) fn joint_state(message: &[u8]) -> Result<JointState<'_>, Fault> {
    let mut bare = Reader::new(message, EmptyList::Bare)?;
    let state = bare.joint_state();
    // Up to three bytes may pad the end of a message; more means that lists were not where they were looked for.
    if state.is_ok() && bare.left() < 4 {
        return state;
    }
    let mut padded = Reader::new(message, EmptyList::Padded)?;
    match padded.joint_state() {
        Ok(other) if padded.left() < 4 => Ok(other),
        _ => state,
    }
}

/// `pkm_msgs/msg/Control`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Control {
    pub(crate) header: Header,
    pub(crate) number: u64,
    pub(crate) flags: u32,
    pub(crate) dt: f64,
    /// In the order of the definition.
    pub(crate) lists: [Vec<f64>; 9],
    /// None in a message of before there was one, which ends here.
    pub(crate) q_dt: Option<f64>,
}

/// Reads a [`Control`].
pub(crate) fn control(message: &[u8]) -> Result<Control, Fault> {
    let mut reader = Reader::new(message, EmptyList::Bare)?;
    let header = reader.header()?;
    let (number, flags) = (reader.u64()?, reader.u32()?);
    let dt = reader.f64s(1)?.first().copied().ok_or(SHORT)?;
    let mut lists: [Vec<f64>; 9] = Default::default();
    for list in &mut lists {
        *list = reader.f64_list()?;
    }
    let q_dt = if reader.left() > 0 { reader.f64s(1)?.first().copied() } else { None };
    Ok(Control { header, number, flags, dt, lists, q_dt })
}

/// Reads a header followed by `n` numbers: `WrenchStamped` (6) and `PoseStamped` (7).
pub(crate) fn stamped(message: &[u8], n: usize) -> Result<(Header, Vec<f64>), Fault> {
    let mut reader = Reader::new(message, EmptyList::Bare)?;
    let header = reader.header()?;
    let numbers = reader.f64s(n)?;
    Ok((header, numbers))
}

/// A message being written, little-endian.
#[derive(Debug, Default)]
pub(crate) struct Writer {
    buffer: Vec<u8>,
}

impl Writer {
    /// Bytes of the encapsulation header: plain CDR, little-endian.
    const HEAD: [u8; 4] = [0, 1, 0, 0];

    /// Starts a new message with its header.
    pub(crate) fn start(&mut self, stamp_ns: i64, frame: &str) {
        self.buffer.clear();
        self.buffer.extend_from_slice(&Self::HEAD);
        // The caller's stamps are within the seconds of an int32; saturation is for nobody.
        let sec = i32::try_from(stamp_ns.div_euclid(1_000_000_000)).unwrap_or(i32::MAX);
        let nanosec = u32::try_from(stamp_ns.rem_euclid(1_000_000_000)).unwrap_or(0);
        self.u32(sec.cast_unsigned());
        self.u32(nanosec);
        self.text(frame);
    }

    /// The message.
    pub(crate) fn finish(&self) -> &[u8] {
        &self.buffer
    }

    fn align(&mut self, to: usize) {
        let wanted = (self.buffer.len() - Self::HEAD.len()).next_multiple_of(to) + Self::HEAD.len();
        self.buffer.resize(wanted, 0);
    }

    /// A 32-bit number.
    pub(crate) fn u32(&mut self, value: u32) {
        self.align(4);
        self.buffer.extend_from_slice(&value.to_le_bytes());
    }

    /// A 64-bit number.
    pub(crate) fn u64(&mut self, value: u64) {
        self.align(8);
        self.buffer.extend_from_slice(&value.to_le_bytes());
    }

    /// A list of numbers with its length.
    pub(crate) fn f64s(&mut self, values: &[f64]) {
        self.count(values.len());
        values.iter().for_each(|value| self.f64(*value));
    }

    /// A length; nothing that fits a file has more than 2³² parts.
    pub(crate) fn count(&mut self, n: usize) {
        self.u32(u32::try_from(n).unwrap_or(u32::MAX));
    }

    /// A text with its closing zero.
    pub(crate) fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.buffer.extend_from_slice(text.as_bytes());
        self.buffer.push(0);
    }

    /// One number.
    pub(crate) fn f64(&mut self, value: f64) {
        self.align(8);
        self.buffer.extend_from_slice(&value.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(lists: [&[f64]; 3]) -> Writer {
        let mut writer = Writer::default();
        writer.start(-1_500_000_000, "");
        writer.count(2);
        writer.text("a");
        writer.text("leg 2");
        for list in lists {
            writer.count(list.len());
            list.iter().for_each(|v| writer.f64(*v));
        }
        writer
    }

    #[test]
    fn joint_state_comes_back() {
        let writer = message([&[1.0, 2.0], &[], &[-3.0, 4.0]]);
        let state = joint_state(writer.finish()).unwrap();
        assert_eq!(state.header.stamp_ns, -1_500_000_000);
        assert_eq!(state.names, ["a", "leg 2"]);
        assert_eq!(state.fields, [vec![1.0, 2.0], vec![], vec![-3.0, 4.0]]);
    }

    #[test]
    fn padding_after_an_empty_list_is_recognised() {
        let mut writer = Writer::default();
        writer.start(0, "");
        writer.count(1);
        writer.text("a");
        for list in [&[7.0][..], &[], &[5.0]] {
            writer.count(list.len());
            writer.align(8);
            list.iter().for_each(|v| writer.f64(*v));
        }
        let state = joint_state(writer.finish()).unwrap();
        assert_eq!(state.fields, [vec![7.0], vec![], vec![5.0]]);
    }

    #[test]
    fn big_endian_is_read() {
        let mut bytes = vec![0, 0, 0, 0];
        for word in [3_u32, 500, 1] {
            bytes.extend(word.to_be_bytes());
        }
        bytes.resize(4 + 16, 0); // empty frame and its padding
        bytes.extend([0; 4 * 4]);
        let state = joint_state(&bytes).unwrap();
        assert_eq!(state.header.stamp_ns, 3_000_000_500);
    }

    #[test]
    fn every_hostile_length_is_an_error() {
        let whole = message([&[1.0, 2.0], &[3.0, 4.0], &[]]).finish().to_vec();
        for at in (4..whole.len() - 3).step_by(4) {
            for hostile in [u32::MAX, u32::MAX - 7, 0x8000_0000, 0x1fff_ffff, 1_000_000] {
                let mut bytes = whole.clone();
                bytes[at..at + 4].copy_from_slice(&hostile.to_le_bytes());
                let _ = joint_state(&bytes);
                let _ = stamped(&bytes, 7);
            }
        }
        let mut names = whole.clone();
        names[20..24].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(joint_state(&names).is_err());
    }

    #[test]
    fn every_cut_is_an_error_or_a_message() {
        let whole = message([&[1.0, 2.0], &[3.0, 4.0], &[5.0, 6.0]]).finish().to_vec();
        for end in 0..whole.len() {
            assert!(joint_state(&whole[..end]).is_err(), "{end}");
        }
    }
}
