//! Message definitions as rosbag2 stores them: the type, then every type it uses behind a separator line.

/// Encoding name of these definitions.
pub(crate) const ENCODING: &str = "ros2msg";
/// Encoding name of the messages.
pub(crate) const MESSAGES: &str = "cdr";

/// Type name of joint states.
pub(crate) const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
/// Type name of wrenches.
pub(crate) const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";
/// Type name of poses.
pub(crate) const POSE: &str = "geometry_msgs/msg/PoseStamped";

/// Type name of one period of a loop.
pub(crate) const CYCLE: &str = "pkm_msgs/msg/Cycle";
/// Type name of one step of a controller.
pub(crate) const CONTROL: &str = "pkm_msgs/msg/Control";

/// Definition of [`CYCLE`], up to the codes.
pub(crate) const CYCLE_HEAD: &str = "\
# One period of a control loop. Clocks are the monotonic one of the loop [ns]; header.stamp is the time of day.
std_msgs/Header header
# Number of the period on the loop's grid; periods that were skipped leave a gap.
uint64 cycle
# When it was to begin, when the loop woke, had read the state, had computed the command, had handed it over.
uint64 planned_ns
uint64 woken_ns
uint64 read_ns
uint64 computed_ns
uint64 done_ns
# Periods that were skipped before this one.
uint64 skipped
# The state that was answered: its number, when it was taken, and which command it says was accepted last.
uint64 state_sequence
uint64 state_stamp_ns
uint64 state_command_sequence
# The command: its number, and until when it holds.
uint64 command_sequence
uint64 command_valid_until_ns
# Time since the last period as controllers saw it, and time into the motion that is played [s].
float64 dt
float64 motion_time
# What the last transition was about, in the unit of its cause.
float64 value
float64 limit
# Codes: what the loop does, why, and at which axis or component.
uint32 phase
uint32 cause
uint32 place
uint32 flags
# Bit i: a limit outside the controller changed the command of drive i; limit i of the controller's own acted.
uint32 clipped
uint32 limited
# Mode of the command; status and drive faults of the state.
uint32 mode
uint32 status
uint32 drive_fault
# Efforts that the model asks for, and those that were asked of the drives before limits [N | N m].
float64[] tau_ff
float64[] tau_cmd
# Measured and wanted wrench, force first [N, N m].
float64[] wrench
float64[] wrench_ref
";

/// Definition of [`CYCLE`], behind the codes.
pub(crate) const CYCLE_TAIL: &str = "\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Definition of [`CONTROL`].
pub(crate) const CONTROL_TEXT: &str = "\
# One step of a controller: all it was given, and what it answered. Enough to do the step again.
std_msgs/Header header
uint64 number
# Bit 0: the controller was set to rest before this step. Bit 1: it reported a fault. Bit 2: it is that of another law than the
# position loop's.
uint32 flags
# Time since the last step [s].
float64 dt
# One value per drive: positions [m | rad], efforts [N | N m], velocities [m/s | rad/s], accelerations [m/s2 | rad/s2].
float64[] q_meas
float64[] tau_meas
# Force, then moment [N, N m].
float64[] wrench_meas
float64[] q_ref
float64[] v_ref
float64[] a_ref
float64[] wrench_ref
# Effort that the model asks for.
float64[] tau_ff
# What the controller answered: efforts [N | N m], or voltages [V].
float64[] command
# Time from the last measured positions to these by the stamps of both [s]; zero where these are not new. Not in files of versions before it.
float64 q_dt
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Definition of [`JOINT_STATE`].
pub(crate) const JOINT_STATE_TEXT: &str = "\
# State of a set of one-degree-of-freedom joints: position [rad | m], velocity [rad/s | m/s], effort [N m | N].
# Each list is as long as name, or empty.
std_msgs/Header header

string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Definition of [`WRENCH`].
pub(crate) const WRENCH_TEXT: &str = "\
# A wrench with the frame it is expressed in and a time stamp.
std_msgs/Header header
Wrench wrench
================================================================================
MSG: geometry_msgs/Wrench
Vector3 force
Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

/// Definition of [`POSE`].
pub(crate) const POSE_TEXT: &str = "\
# A pose with the frame it is expressed in and a time stamp.
std_msgs/Header header
Pose pose
================================================================================
MSG: geometry_msgs/Pose
Point position
Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";
