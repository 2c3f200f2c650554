//! Message definitions as rosbag2 stores them: the type, then every type it uses behind a separator line.

/// Encoding name of these definitions.
pub(super) const ENCODING: &str = "ros2msg";
/// Encoding name of the messages.
pub(super) const MESSAGES: &str = "cdr";

/// Type name of joint states.
pub(super) const JOINT_STATE: &str = "sensor_msgs/msg/JointState";
/// Type name of wrenches.
pub(super) const WRENCH: &str = "geometry_msgs/msg/WrenchStamped";
/// Type name of poses.
pub(super) const POSE: &str = "geometry_msgs/msg/PoseStamped";

/// Definition of [`JOINT_STATE`].
pub(super) const JOINT_STATE_TEXT: &str = "\
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
pub(super) const WRENCH_TEXT: &str = "\
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
pub(super) const POSE_TEXT: &str = "\
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
