// Pinocchio's side of `cargo xtask peers`: reads a robot and states that pkm wrote, and on request runs one algorithm over all of them,
// for its time or for its numbers. Requests are lines on standard input; each is answered by one line:
//
//   load FOLDER           reads FOLDER/robot.txt and FOLDER/states.bin        -> ok
//   time ALGORITHM        one pass over all states                            -> nanoseconds per call
//   count ALGORITHM       as `time`, for the iterations of a loop closure     -> mean number of Newton steps
//   write ALGORITHM FILE  results of all states as 64-bit floats              -> ok
//
// The robot comes as numbers, not as a URDF: the wheel's URDF reader is compiled for generic x86-64, and a model it makes must not be
// used by code compiled with -march=native (Eigen then aligns differently). Joints are the types Pinocchio's own URDF reader takes.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/LU>

#include <pinocchio/multibody.hpp>
#include <pinocchio/constraints.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/proximal.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace pin = pinocchio;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

/// A point a of one body that must stay at a point b of another.
struct Loop {
  pin::JointIndex a, b;
  pin::SE3 pose_a, pose_b;
};

/// One row of states.bin; `before` are closed poses 1 ms and 10 ms earlier.
struct State {
  VectorXd q, v, a, tau, before[2];
};

struct Robot {
  pin::Model model;
  std::vector<Loop> loops;
  std::vector<pin::RigidConstraintModel> contacts;
  std::vector<int> active, passive;
  std::vector<State> states;
};

double number(std::istream& in) {
  std::string word;
  if (!(in >> word)) throw std::runtime_error("robot.txt ends too early");
  return std::strtod(word.c_str(), nullptr);
}

pin::SE3 pose(std::istream& in) {
  pin::SE3 out;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) out.rotation()(r, c) = number(in);
  for (int k = 0; k < 3; ++k) out.translation()[k] = number(in);
  return out;
}

/// The types Pinocchio's URDF reader takes: those along or about a coordinate axis are cheaper.
pin::JointModel joint(const std::string& kind, const Vector3d& axis) {
  const bool turns = kind == "revolute";
  if (axis == Vector3d::UnitX()) return turns ? pin::JointModel(pin::JointModelRX()) : pin::JointModel(pin::JointModelPX());
  if (axis == Vector3d::UnitY()) return turns ? pin::JointModel(pin::JointModelRY()) : pin::JointModel(pin::JointModelPY());
  if (axis == Vector3d::UnitZ()) return turns ? pin::JointModel(pin::JointModelRZ()) : pin::JointModel(pin::JointModelPZ());
  if (turns) return pin::JointModelRevoluteUnaligned(axis);
  return pin::JointModelPrismaticUnaligned(axis);
}

pin::JointIndex body(std::istream& in) { return static_cast<pin::JointIndex>(number(in)) ; }

void read_joints(std::istream& in, Robot& robot) {
  const int n = static_cast<int>(number(in));
  VectorXd armature(n);
  for (int i = 0; i < n; ++i) {
    const pin::JointIndex parent = body(in);
    std::string kind;
    in >> kind;
    Vector3d axis;
    for (int k = 0; k < 3; ++k) axis[k] = number(in);
    const pin::SE3 placement = pose(in);
    Eigen::Matrix<double, 10, 1> parameters;
    for (int k = 0; k < 10; ++k) parameters[k] = number(in);
    armature[i] = number(in);
    (number(in) != 0.0 ? robot.active : robot.passive).push_back(i);
    const auto id = robot.model.addJoint(parent, joint(kind, axis), placement, "j" + std::to_string(i));
    const bool is_massless = parameters[0] == 0.0;
    const pin::Inertia inertia = is_massless ? pin::Inertia::Zero() : pin::Inertia::FromDynamicParameters(parameters);
    robot.model.appendBodyToJoint(id, inertia, pin::SE3::Identity());
  }
  robot.model.armature = armature;
}

void read_states(const std::string& path, Robot& robot, size_t count) {
  std::ifstream in(path, std::ios::binary);
  const int nv = robot.model.nv;
  robot.states.resize(count);
  for (State& s : robot.states)
    for (VectorXd* x : {&s.q, &s.v, &s.a, &s.tau, &s.before[0], &s.before[1]}) {
      x->resize(nv);
      in.read(reinterpret_cast<char*>(x->data()), nv * static_cast<std::streamsize>(sizeof(double)));
    }
  if (!in) throw std::runtime_error(path + " is too short");
}

Robot read(const std::string& folder) {
  Robot robot;
  std::ifstream in(folder + "/robot.txt");
  if (!in) throw std::runtime_error(folder + "/robot.txt cannot be read");
  Vector3d gravity;
  for (int k = 0; k < 3; ++k) gravity[k] = number(in);
  robot.model.gravity.linear() = gravity;
  read_joints(in, robot);
  const int loops = static_cast<int>(number(in));
  for (int k = 0; k < loops; ++k) {
    Loop loop;
    loop.a = body(in);
    loop.pose_a = pose(in);
    loop.b = body(in);
    loop.pose_b = pose(in);
    robot.loops.push_back(loop);
    robot.contacts.emplace_back(pin::ContactType::CONTACT_3D, robot.model, loop.a, loop.pose_a, loop.b, loop.pose_b, pin::LOCAL);
  }
  read_states(folder + "/states.bin", robot, static_cast<size_t>(number(in)));
  return robot;
}

/// Inverse dynamics of a closed-loop robot. Pinocchio 4.1 has no algorithm for it, so this puts together the ones it has, with one LU
/// factorisation of the passive columns of the constraint Jacobian per pose and everything allocated beforehand.
class ClosedLoop {
 public:
  explicit ClosedLoop(const Robot& robot)
      : robot_(robot),
        model_(robot.model),
        data_(robot.model),
        rows_(3 * static_cast<int>(robot.loops.size())),
        is_square_(rows_ > 0 && rows_ == static_cast<int>(robot.passive.size())),
        column_(robot.model.nv),
        jacobian_passive_(MatrixXd::Zero(rows_, static_cast<int>(robot.passive.size()))),
        jacobian_active_(MatrixXd::Zero(rows_, static_cast<int>(robot.active.size()))),
        lu_(rows_),
        gap_(rows_),
        right_(rows_),
        solved_(rows_),
        zero_(VectorXd::Zero(robot.model.nv)),
        q_(robot.model.nv),
        v_(robot.model.nv),
        a_(robot.model.nv),
        tau_act_(robot.active.size()) {
    for (size_t k = 0; k < robot.active.size(); ++k) column_[robot.active[k]] = -1 - static_cast<int>(k);
    for (size_t k = 0; k < robot.passive.size(); ++k) column_[robot.passive[k]] = static_cast<int>(k);
  }

  bool is_square() const { return is_square_; }
  const VectorXd& tau_act() const { return tau_act_; }

  /// Efforts of the drives for a known motion of the whole tree.
  void effort(const VectorXd& q, const VectorXd& v, const VectorXd& a) {
    factor(q);
    project(q, v, a);
  }

  /// Closes the loops from the pose `before`, then velocities, accelerations and the efforts of the drives; the number of Newton steps.
  int step(const VectorXd& before, const State& s) {
    q_ = before;
    for (int j : robot_.active) q_[j] = s.q[j];
    int steps = 0;
    for (;; ++steps) {
      factor(q_);
      if (gap_.lpNorm<Eigen::Infinity>() <= 1e-12 || steps == 30) break;
      solved_.noalias() = lu_.solve(gap_);
      for (int k = 0; k < rows_; ++k) q_[robot_.passive[k]] -= solved_[k];
    }
    follow(s.v, v_, [](VectorXd&) {});
    pin::forwardKinematics(model_, data_, q_, v_, zero_);
    follow(s.a, a_, [this](VectorXd& right) { add_drift(right); });
    project(q_, v_, a_);
    return steps;
  }

 private:
  /// Gap of the loops and its Jacobian in the world frame, and the factors of the passive columns.
  void factor(const VectorXd& q) {
    pin::computeJointJacobians(model_, data_, q);
    jacobian_passive_.setZero();
    jacobian_active_.setZero();
    for (size_t l = 0; l < robot_.loops.size(); ++l) {
      const Loop& loop = robot_.loops[l];
      const Vector3d a = data_.oMi[loop.a].act(loop.pose_a.translation()), b = data_.oMi[loop.b].act(loop.pose_b.translation());
      const int row = 3 * static_cast<int>(l);
      gap_.segment<3>(row) = b - a;
      add_point(loop.b, b, 1.0, row);
      add_point(loop.a, a, -1.0, row);
    }
    lu_.compute(jacobian_passive_);
  }

  /// Adds the Jacobian of a point of a body: columns of data.J are motions of each joint's subtree seen at the world's origin.
  void add_point(pin::JointIndex j, const Vector3d& at, double sign, int row) {
    for (; j > 0; j = model_.parents[j]) {
      const int i = model_.joints[j].idx_v();
      const Vector3d linear = sign * (data_.J.block<3, 1>(0, i) + data_.J.block<3, 1>(3, i).cross(at));
      if (column_[i] >= 0)
        jacobian_passive_.block<3, 1>(row, column_[i]) += linear;
      else
        jacobian_active_.block<3, 1>(row, -1 - column_[i]) += linear;
    }
  }

  /// Tree velocities or accelerations from those of the drives in `given`.
  template <class Drift>
  void follow(const VectorXd& given, VectorXd& out, Drift drift) {
    right_.setZero();
    drift(right_);
    for (size_t k = 0; k < robot_.active.size(); ++k) {
      out[robot_.active[k]] = given[robot_.active[k]];
      right_.noalias() += jacobian_active_.col(static_cast<int>(k)) * given[robot_.active[k]];
    }
    solved_.noalias() = lu_.solve(right_);
    for (int k = 0; k < rows_; ++k) out[robot_.passive[k]] = -solved_[k];
  }

  /// Classical acceleration of a point of a body at zero joint acceleration.
  Vector3d acceleration(pin::JointIndex j, const Vector3d& p) const {
    const auto &v = data_.v[j], &a = data_.a[j];
    const Vector3d velocity = v.linear() + v.angular().cross(p);
    return data_.oMi[j].rotation() * (a.linear() + a.angular().cross(p) + v.angular().cross(velocity));
  }

  void add_drift(VectorXd& right) const {
    for (size_t l = 0; l < robot_.loops.size(); ++l) {
      const Loop& loop = robot_.loops[l];
      right.segment<3>(3 * static_cast<int>(l)) +=
          acceleration(loop.b, loop.pose_b.translation()) - acceleration(loop.a, loop.pose_a.translation());
    }
  }

  /// The loop forces that leave the passive joints free of effort, and what they leave to the drives.
  void project(const VectorXd& q, const VectorXd& v, const VectorXd& a) {
    const VectorXd& tau = pin::rnea(model_, data_, q, v, a);
    for (int k = 0; k < rows_; ++k) right_[k] = tau[robot_.passive[k]];
    solved_.noalias() = lu_.transpose().solve(right_);
    for (size_t k = 0; k < robot_.active.size(); ++k)
      tau_act_[static_cast<int>(k)] = tau[robot_.active[k]] - jacobian_active_.col(static_cast<int>(k)).dot(solved_);
  }

  const Robot& robot_;
  const pin::Model& model_;
  pin::Data data_;
  int rows_;
  bool is_square_;
  std::vector<int> column_;
  MatrixXd jacobian_passive_, jacobian_active_;
  Eigen::PartialPivLU<MatrixXd> lu_;
  VectorXd gap_, right_, solved_, zero_, q_, v_, a_, tau_act_;
};

/// Keeps the compiler from leaving out what nobody reads.
template <class T>
void keep(const T& x) {
  asm volatile("" : : "g"(&x) : "memory");
}

/// What one request is about to do with each algorithm: time it, or write its numbers.
class Session {
 public:
  explicit Session(const std::string& folder) : robot_(read(folder)), data_(robot_.model), closed_(robot_), settings_(1e-14, 0.0, 1) {
    for (const auto& contact : robot_.contacts) contact_data_.push_back(contact.createData());
    if (!robot_.contacts.empty()) pin::initConstraintDynamics(robot_.model, data_, robot_.contacts, contact_data_);
    zero_ = VectorXd::Zero(robot_.model.nv);
  }

  /// Calls `use(call, result)` for the algorithm: `call(state)` runs it, `result(out)` appends its numbers.
  template <class Use>
  void with(const std::string& name, Use use) {
    const pin::Model& m = robot_.model;
    pin::Data& d = data_;
    const auto append = [](std::vector<double>& out, const auto& x) { out.insert(out.end(), x.data(), x.data() + x.size()); };
    const auto mass = [&](std::vector<double>& out) {
      MatrixXd full = d.M.selfadjointView<Eigen::Upper>();
      append(out, full);
    };
    if (name == "rnea") {
      use([&](const State& s) { keep(pin::rnea(m, d, s.q, s.v, s.a)); }, [&](auto& out) { append(out, d.tau); });
    } else if (name == "nle") {
      use([&](const State& s) { keep(pin::nonLinearEffects(m, d, s.q, s.v)); }, [&](auto& out) { append(out, d.nle); });
    } else if (name == "crba_local") {
      use([&](const State& s) { keep(pin::crba(m, d, s.q, pin::Convention::LOCAL)); }, mass);
    } else if (name == "crba_world") {
      use([&](const State& s) { keep(pin::crba(m, d, s.q, pin::Convention::WORLD)); }, mass);
    } else if (name == "aba_local") {
      use([&](const State& s) { keep(pin::aba(m, d, s.q, s.v, s.tau, pin::Convention::LOCAL)); },
          [&](auto& out) { append(out, d.ddq); });
    } else if (name == "aba_world") {
      use([&](const State& s) { keep(pin::aba(m, d, s.q, s.v, s.tau, pin::Convention::WORLD)); },
          [&](auto& out) { append(out, d.ddq); });
    } else if (name == "joint_torque_regressor") {
      use([&](const State& s) { keep(pin::computeJointTorqueRegressor(m, d, s.q, s.v, s.a)); },
          [&](auto& out) { append(out, d.jointTorqueRegressor); });
    } else if (name == "kinematics") {
      use([&](const State& s) { pin::forwardKinematics(m, d, s.q, s.v, s.a); keep(d); }, [&](auto& out) { write_motion(out); });
    } else if (name == "joint_jacobians") {
      use([&](const State& s) { keep(pin::computeJointJacobians(m, d, s.q)); }, [&](auto& out) { append(out, d.J); });
    } else if (name == "forward_dynamics" && !robot_.loops.empty()) {
      use([&](const State& s) { keep(pin::constraintDynamics(m, d, s.q, s.v, s.tau, robot_.contacts, contact_data_, settings_)); },
          [&](auto& out) { append(out, d.ddq); });
    } else if (name == "effort" && closed_.is_square()) {
      use([&](const State& s) { closed_.effort(s.q, s.v, s.a); keep(closed_); }, [&](auto& out) { append(out, closed_.tau_act()); });
    } else if (name == "step_1ms" && closed_.is_square()) {
      use([&](const State& s) { steps_ += closed_.step(s.before[0], s); keep(closed_); },
          [&](auto& out) { append(out, closed_.tau_act()); });
    } else if (name == "step_10ms" && closed_.is_square()) {
      use([&](const State& s) { steps_ += closed_.step(s.before[1], s); keep(closed_); },
          [&](auto& out) { append(out, closed_.tau_act()); });
    } else {
      throw std::runtime_error("no algorithm " + name + " for this robot");
    }
  }

  double time(const std::string& name) {
    double out = 0.0;
    with(name, [&](auto call, auto) {
      // The other side has just had the processor: fill the caches again first.
      for (size_t k = 0; k < robot_.states.size() / 8; ++k) call(robot_.states[k]);
      steps_ = 0;
      const auto start = std::chrono::steady_clock::now();
      for (const State& s : robot_.states) call(s);
      const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - start;
      out = took.count() / static_cast<double>(robot_.states.size());
    });
    return out;
  }

  double mean_steps(const std::string& name) {
    time(name);
    return static_cast<double>(steps_) / static_cast<double>(robot_.states.size());
  }

  void write(const std::string& name, const std::string& path) {
    std::vector<double> out;
    with(name, [&](auto call, auto result) {
      for (const State& s : robot_.states) {
        call(s);
        result(out);
      }
    });
    std::ofstream file(path, std::ios::binary);
    file.write(reinterpret_cast<const char*>(out.data()), static_cast<std::streamsize>(out.size() * sizeof(double)));
    if (!file) throw std::runtime_error(path + " cannot be written");
  }

 private:
  void write_motion(std::vector<double>& out) const {
    for (size_t j = 1; j < static_cast<size_t>(robot_.model.njoints); ++j) {
      const auto& x = data_.oMi[j];
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) out.push_back(x.rotation()(r, c));
      for (int k = 0; k < 3; ++k) out.push_back(x.translation()[k]);
      for (int k = 0; k < 6; ++k) out.push_back(data_.v[j].toVector()[k]);
      for (int k = 0; k < 6; ++k) out.push_back(data_.a[j].toVector()[k]);
    }
  }

  Robot robot_;
  pin::Data data_;
  ClosedLoop closed_;
  pin::ProximalSettings settings_;
  std::vector<pin::RigidConstraintData> contact_data_;
  VectorXd zero_;
  long steps_ = 0;
};

std::string answer(std::unique_ptr<Session>& session, const std::string& line) {
  std::istringstream words(line);
  std::string verb, subject, file;
  words >> verb >> subject >> file;
  if (verb == "load") {
    session = std::make_unique<Session>(subject);
    return "ok";
  }
  if (!session) throw std::runtime_error("nothing is loaded");
  if (verb == "time") return std::to_string(session->time(subject));
  if (verb == "count") return std::to_string(session->mean_steps(subject));
  if (verb == "write") {
    session->write(subject, file);
    return "ok";
  }
  throw std::runtime_error("no request " + verb);
}

}  // namespace

int main() {
  std::unique_ptr<Session> session;
  for (std::string line; std::getline(std::cin, line);) {
    try {
      std::cout << answer(session, line) << std::endl;
    } catch (const std::exception& error) {
      std::cout << "error: " << error.what() << std::endl;
    }
  }
}
