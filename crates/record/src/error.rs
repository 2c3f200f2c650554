//! What can go wrong at the edge. Every message is one line: what, where, value, limit.

/// Why a file could not be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReadError {
    /// The file system refuses.
    #[error("{file}: {detail}")]
    Io {
        /// File as given.
        file: String,
        /// What the system says.
        detail: String,
    },
    /// Neither of the known extensions.
    #[error("{file}: unknown kind of recording (known: .csv, .mcap)")]
    UnknownFormat {
        /// File as given.
        file: String,
    },
    /// A bag of ROS 2 in a database.
    #[error("{file}: a rosbag2 in SQLite is not read: make it an MCAP with `ros2 bag convert` (storage_id: mcap)")]
    Sqlite {
        /// File as given.
        file: String,
    },
    /// A folder that is not one recording.
    #[error("{file}: a folder with {found} MCAP files (a bag of one is read; of a split one, name the file)")]
    Folder {
        /// Folder as given.
        file: String,
        /// How many there are.
        found: usize,
    },
    /// Nothing in the file.
    #[error("{file}: the file is empty")]
    Empty {
        /// File as given.
        file: String,
    },
    /// Text in another encoding.
    #[error("{file} line {line}: not UTF-8 text")]
    NotUtf8 {
        /// File as given.
        file: String,
        /// Line, from 1.
        line: usize,
    },
    /// Lines, but none with column names.
    #[error("{file}: no header line with column names")]
    NoHeader {
        /// File as given.
        file: String,
    },
    /// A known metadata key with a value of another kind.
    #[error("{at}: {key} = {value} is not {wants}")]
    Metadata {
        /// File and place in it.
        at: String,
        /// Metadata key.
        key: String,
        /// Value as written.
        value: String,
        /// What the key takes.
        wants: String,
    },
    /// A known metadata key given twice.
    #[error("{file} line {line}: {key} is given twice")]
    DuplicateKey {
        /// File as given.
        file: String,
        /// Line of the second, from 1.
        line: usize,
        /// Metadata key.
        key: String,
    },
    /// No time column.
    #[error("{file} line {line}: no column t, the time in seconds (columns: {found}){hint}")]
    MissingTime {
        /// File as given.
        file: String,
        /// Line of the header, from 1.
        line: usize,
        /// Columns there are.
        found: String,
        /// What else may be wrong.
        hint: &'static str,
    },
    /// Two columns of one name.
    #[error("{file} line {line}: column {column} is there twice")]
    DuplicateColumn {
        /// File as given.
        file: String,
        /// Line of the header, from 1.
        line: usize,
        /// Column name.
        column: String,
    },
    /// A column without a name.
    #[error("{file} line {line}: column number {number} has no name")]
    UnnamedColumn {
        /// File as given.
        file: String,
        /// Line of the header, from 1.
        line: usize,
        /// Which column, from 1.
        number: usize,
    },
    /// A line with too few or too many fields.
    #[error("{file} line {line}: {found} fields, the header has {wanted}")]
    FieldCount {
        /// File as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Fields in the line.
        found: usize,
        /// Fields in the header.
        wanted: usize,
    },
    /// A field that is no number.
    #[error("{file} line {line}, column {column}: \"{value}\" is not a number")]
    NotANumber {
        /// File as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column name.
        column: String,
        /// Field as written.
        value: String,
    },
    /// A number too large to be one, or a missing time.
    #[error("{file} line {line}, column {column}: \"{value}\" is not finite")]
    NotFinite {
        /// File as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Column name.
        column: String,
        /// Field as written.
        value: String,
    },
    /// Time stands still or runs backwards.
    #[error("{file} line {line}: t = {t} s does not increase (line before: {before} s)")]
    NotIncreasing {
        /// File as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Its time `[s]`.
        t: f64,
        /// Time of the sample before `[s]`.
        before: f64,
    },
    /// Columns but no samples.
    #[error("{file}: no samples")]
    NoSamples {
        /// File as given.
        file: String,
    },
    /// The first bytes are not those of an MCAP file.
    #[error("{file}: not an MCAP file (its first 8 bytes are not the MCAP magic)")]
    NotMcap {
        /// File as given.
        file: String,
    },
    /// An MCAP file cut short or altered.
    #[error("{file} byte {byte}: {what}; {messages} messages are readable, `pkm convert --recover` mends the file")]
    Damaged {
        /// File as given.
        file: String,
        /// Place of the first damage.
        byte: u64,
        /// What is wrong there.
        what: String,
        /// Messages that can be read all the same.
        messages: u64,
    },
    /// No topic with joint states.
    #[error("{file}: no topic of type sensor_msgs/msg/JointState (topics: {topics})")]
    NoJointState {
        /// File as given.
        file: String,
        /// Topics there are.
        topics: String,
    },
    /// Several topics with joint states and none is `/joint_states`.
    #[error("{file}: several topics of type sensor_msgs/msg/JointState, choose one with --topic: {topics}")]
    SeveralTopics {
        /// File as given.
        file: String,
        /// Topics that qualify.
        topics: String,
    },
    /// The wanted topic is not there, or holds no joint states.
    #[error("{file}: no topic {wanted} of type sensor_msgs/msg/JointState (there is: {topics})")]
    NoTopic {
        /// File as given.
        file: String,
        /// Topic asked for.
        wanted: String,
        /// Topics that qualify.
        topics: String,
    },
    /// A message that is not what its schema says.
    #[error("{file}: message {number} of topic {topic} cannot be read: {what}; `pkm convert --recover` leaves it out")]
    Message {
        /// File as given.
        file: String,
        /// Topic.
        topic: String,
        /// Which message of the topic, from 1.
        number: u64,
        /// What is wrong with it.
        what: &'static str,
    },
    /// A few values spread over far more columns and samples than the file can fill.
    #[error("{file}: {columns} columns of {samples} samples would be almost empty")]
    TooSparse {
        /// File as given.
        file: String,
        /// Columns so far.
        columns: usize,
        /// Samples of the time axis.
        samples: usize,
    },
    /// An infinite value in a message.
    #[error("{file} at t = {t} s, column {column}: {value} is not finite")]
    InfiniteSample {
        /// File as given.
        file: String,
        /// Time of the sample `[s]`.
        t: f64,
        /// Column name.
        column: String,
        /// The value.
        value: f64,
    },
}

/// Why a file could not be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WriteError {
    /// The file system refuses.
    #[error("{file}: {detail}")]
    Io {
        /// File as given.
        file: String,
        /// What the system says.
        detail: String,
    },
    /// Neither of the known extensions.
    #[error("{file}: unknown kind of recording (known: .csv, .mcap)")]
    UnknownFormat {
        /// File as given.
        file: String,
    },
    /// A recording without samples could not be read back.
    #[error("{file}: the recording has no samples")]
    NoSamples {
        /// File as given.
        file: String,
    },
    /// Times must be finite and increase.
    #[error("{file}: sample {sample} has t = {t} s, which does not increase (sample before: {before} s)")]
    Time {
        /// File as given.
        file: String,
        /// Sample, from 0.
        sample: usize,
        /// Its time `[s]`.
        t: f64,
        /// Time of the sample before `[s]`.
        before: f64,
    },
    /// Stamps are whole nanoseconds below 2³¹ s.
    #[error("{file}: sample {sample} at t = {t} s has no time stamp of its own (limits: 1 ns apart, below 2147483648 s)")]
    Stamp {
        /// File as given.
        file: String,
        /// Sample, from 0.
        sample: usize,
        /// Its time `[s]`.
        t: f64,
    },
    /// A name that a header line cannot carry.
    #[error("{file}: {column:?} cannot be a column name (one line, no space around, not empty, not t)")]
    ColumnName {
        /// File as given.
        file: String,
        /// Signal name.
        column: String,
    },
    /// A signal shorter or longer than the time axis.
    #[error("{file}: column {column} has {found} samples, the time axis {wanted}")]
    Length {
        /// File as given.
        file: String,
        /// Signal name.
        column: String,
        /// Its samples.
        found: usize,
        /// Samples of the time axis.
        wanted: usize,
    },
    /// An infinite value; a missing sample is NaN.
    #[error("{file}: column {column}, sample {sample} is infinite")]
    NotFinite {
        /// File as given.
        file: String,
        /// Signal name.
        column: String,
        /// Sample, from 0.
        sample: usize,
    },
    /// A metadata key that is not one word, is taken, or has a value that cannot be written.
    #[error("{file}: metadata {key:?} cannot be written (one word, not the name of a known key, finite numbers)")]
    Key {
        /// File as given.
        file: String,
        /// Metadata key.
        key: String,
    },
}

/// What of a file's text goes into a message: one line, not too long.
pub(crate) fn clip(text: &str) -> String {
    const LONGEST: usize = 60;
    let mut clipped: String = text.chars().take(LONGEST).flat_map(char::escape_debug).collect();
    if text.chars().nth(LONGEST).is_some() {
        clipped.push('…');
    }
    clipped
}

/// Names in one line; the end of a long list is left out.
pub(crate) fn list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const MOST: usize = 20;
    let names: Vec<&str> = names.into_iter().collect();
    let mut text: Vec<String> = names.iter().take(MOST).map(|n| clip(n)).collect();
    if names.len() > MOST {
        text.push(format!("and {} more", names.len() - MOST));
    }
    if text.is_empty() { "none".to_string() } else { text.join(", ") }
}
