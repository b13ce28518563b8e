// Model predictive control of thesis equations 3.46-3.49 with Ceres: the peer of our controller.
//
// Owns the problem as the thesis wrote it: single shooting, one block of all inputs with bounds, the states
// rolled out in the cost function, absolute input cost; the Jacobian is analytic. It shares no code with ours,
// so that it also checks the result.
//
//   mpc_ceres FILE cold|warm FUNCTION_TOLERANCE SOLVER RADIUS
//
// FILE: `problems horizon`, then per problem p, s_0 and s_ref, four numbers each. A cold solve starts from zero
// inputs, a warm one from the last solution moved on by one step. Prints per problem the time of the solve in
// ns, its iterations, its cost and the inputs; building, filling and shifting are not timed.

#include <glog/logging.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "ceres_peer.hpp"

namespace {

// Weights multiply residuals. States: x, y, z, theta. Inputs: roll, pitch, yaw, throttle.
constexpr Vec4 kCu = {1.2, 1.2, 0.8, 0.8};
constexpr Vec4 kCs = {1.5, 1.5, 1.0, 1.0};
constexpr Vec4 kCsEnd = {15.0, 15.0, 10.0, 10.0};
constexpr Vec4 kBound = {0.8, 0.8, 1.0, 1.0};

struct Ask {
  Vec4 p, s_0, s_ref;
};

// C_u u_k and C_s (s_{k+1} - s_ref), k = 0 .. horizon - 1.
class Flight : public ceres::CostFunction {
 public:
  Flight(const Ask* ask, int horizon) : ask_(ask), horizon_(horizon), s_(horizon + 1) {
    mutable_parameter_block_sizes()->push_back(4 * horizon);
    set_num_residuals(8 * horizon);
  }

  bool Evaluate(double const* const* x, double* r, double** by) const override {
    const double* u = x[0];
    const Vec4& p = ask_->p;
    s_[0] = ask_->s_0;
    for (int k = 0; k < horizon_; ++k) {
      const double *uk = u + 4 * k, psi = s_[k][3] + p[3], c = std::cos(psi), d = std::sin(psi);
      s_[k + 1] = {s_[k][0] + kDtS * p[0] * (c * uk[1] + d * uk[0]), s_[k][1] + kDtS * p[0] * (d * uk[1] - c * uk[0]),
                   s_[k][2] + kDtS * p[1] * uk[3], s_[k][3] + kDtS * p[2] * uk[2]};
      const Vec4& weight = k + 1 < horizon_ ? kCs : kCsEnd;
      for (int i = 0; i < 4; ++i) {
        r[8 * k + i] = kCu[i] * uk[i];
        r[8 * k + 4 + i] = weight[i] * (s_[k + 1][i] - ask_->s_ref[i]);
      }
    }
    if (by != nullptr && by[0] != nullptr) Jacobian(by[0]);
    return true;
  }

 private:
  // A change of heading in step j turns all of the way from step j + 1 on.
  void Jacobian(double* by) const {
    const int columns = 4 * horizon_;
    const Vec4& p = ask_->p;
    std::memset(by, 0, sizeof(double) * 8 * horizon_ * columns);
    for (int j = 0; j < horizon_; ++j) {
      const double psi = s_[j][3] + p[3], c = std::cos(psi), d = std::sin(psi), h = kDtS * p[0], yaw = kDtS * p[2];
      for (int k = j; k < horizon_; ++k) {
        const Vec4& weight = k + 1 < horizon_ ? kCs : kCsEnd;
        double* row = by + (8 * k + 4) * columns + 4 * j;
        row[0] = weight[0] * h * d;
        row[1] = weight[0] * h * c;
        row[2] = -weight[0] * yaw * (s_[k + 1][1] - s_[j + 1][1]);
        row += columns;
        row[0] = -weight[1] * h * c;
        row[1] = weight[1] * h * d;
        row[2] = weight[1] * yaw * (s_[k + 1][0] - s_[j + 1][0]);
        row += columns;
        row[3] = weight[2] * kDtS * p[1];
        row += columns;
        row[2] = weight[3] * yaw;
      }
      for (int i = 0; i < 4; ++i) by[(8 * j + i) * columns + 4 * j + i] = kCu[i];
    }
  }

  const Ask* ask_;
  int horizon_;
  mutable std::vector<Vec4> s_;
};

}  // namespace

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  std::FILE* file = argc == 6 ? std::fopen(argv[1], "r") : nullptr;
  int problems = 0, horizon = 0;
  if (file == nullptr || std::fscanf(file, "%d %d", &problems, &horizon) != 2 || horizon < 1) {
    std::fprintf(stderr, "usage: mpc_ceres FILE cold|warm FUNCTION_TOLERANCE SOLVER RADIUS\n");
    return 2;
  }
  const bool is_warm = std::strcmp(argv[2], "warm") == 0;

  Ask ask;
  std::vector<double> u(4 * horizon, 0.0);
  ceres::Problem::Options fast;
  fast.disable_all_safety_checks = true;
  ceres::Problem problem(fast);
  problem.AddResidualBlock(new Flight(&ask, horizon), nullptr, u.data());
  for (int i = 0; i < 4 * horizon; ++i) {
    problem.SetParameterLowerBound(u.data(), i, -kBound[i % 4]);
    problem.SetParameterUpperBound(u.data(), i, kBound[i % 4]);
  }

  ceres::Solver::Options options;
  if (!ParseOptions(argv + 3, &options)) return 2;

  for (int at = 0; at < problems; ++at) {
    if (!Read(file, &ask.p) || !Read(file, &ask.s_0) || !Read(file, &ask.s_ref)) {
      std::fprintf(stderr, "problem %d is not whole\n", at);
      return 2;
    }
    if (is_warm) {
      std::copy(u.begin() + 4, u.end(), u.begin());
    } else {
      std::fill(u.begin(), u.end(), 0.0);
    }
    SolveTimed(options, &problem);
    for (const double value : u) std::printf(" %.17g", value);
    std::printf("\n");
  }
  return 0;
}
