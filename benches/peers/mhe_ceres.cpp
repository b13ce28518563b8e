// Moving horizon estimates of thesis equations 3.42-3.45 with Ceres: the peer of our estimator.
//
// Owns the problem as a careful user of Ceres would write it: analytic derivatives, one residual block
// per observation, transition and prior, built once and refilled for every window. It shares no code
// with ours, so that it also checks the result.
//
//   mhe_ceres FILE cold|warm FUNCTION_TOLERANCE SOLVER RADIUS
//
// FILE: `windows steps`, then per window the fixed state s_0 and `steps` times the input that acted and the
// observation after it, four numbers each. A cold solve starts where the model leads from s_0 with the prior
// parameter, a warm one from the last solution moved on by one step. Prints per window the time of the
// solve in ns, its iterations and its cost; building, filling and shifting are not timed.

#include <glog/logging.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "ceres_peer.hpp"

namespace {

// Weights multiply residuals. States: x, y, z, theta. Parameter: lambda_h, lambda_v, lambda_a, theta_0.
constexpr Vec4 kCo = {3.0, 3.0, 2.0, 0.5};
constexpr Vec4 kCs = {0.4, 0.4, 0.4, 0.2};
constexpr Vec4 kCp = {20.0, 20.0, 20.0, 100.0};
constexpr Vec4 kPrior = {1.29, 0.445, 0.994, 0.033};

// C_p (p - p_prior)
class Prior : public ceres::SizedCostFunction<4, 4> {
 public:
  bool Evaluate(double const* const* x, double* r, double** by) const override {
    for (int i = 0; i < 4; ++i) r[i] = kCp[i] * (x[0][i] - kPrior[i]);
    if (by != nullptr && by[0] != nullptr) {
      std::memset(by[0], 0, 16 * sizeof(double));
      for (int i = 0; i < 4; ++i) by[0][5 * i] = kCp[i];
    }
    return true;
  }
};

// C_o (s_k - o_k)
class Observation : public ceres::SizedCostFunction<4, 4> {
 public:
  explicit Observation(const Vec4* o) : o_(o) {}
  bool Evaluate(double const* const* x, double* r, double** by) const override {
    for (int i = 0; i < 4; ++i) r[i] = kCo[i] * (x[0][i] - (*o_)[i]);
    if (by != nullptr && by[0] != nullptr) {
      std::memset(by[0], 0, 16 * sizeof(double));
      for (int i = 0; i < 4; ++i) by[0][5 * i] = kCo[i];
    }
    return true;
  }

 private:
  const Vec4* o_;
};

// World velocity of equation 4.1.
Vec4 Velocity(const double* s, const Vec4& u, const double* p) {
  const auto [roll, pitch, yaw, throttle] = u;
  const double c = std::cos(s[3] + p[3]), d = std::sin(s[3] + p[3]);
  return {p[0] * (d * roll + c * pitch), p[0] * (d * pitch - c * roll), p[1] * throttle, p[2] * yaw};
}

// C_s ((s_k - s_{k+1}) / dt + f(s_k, u_k, p))
class Transition : public ceres::SizedCostFunction<4, 4, 4, 4> {
 public:
  explicit Transition(const Vec4* u) : u_(u) {}
  bool Evaluate(double const* const* x, double* r, double** by) const override {
    const double *s = x[0], *s_next = x[1], *p = x[2];
    const Vec4 v = Velocity(s, *u_, p);
    for (int i = 0; i < 4; ++i) r[i] = kCs[i] * ((s[i] - s_next[i]) / kDtS + v[i]);
    if (by == nullptr) return true;
    if (by[0] != nullptr) {
      std::memset(by[0], 0, 16 * sizeof(double));
      for (int i = 0; i < 4; ++i) by[0][5 * i] = kCs[i] / kDtS;
      by[0][3] = -kCs[0] * v[1];
      by[0][7] = kCs[1] * v[0];
    }
    if (by[1] != nullptr) {
      std::memset(by[1], 0, 16 * sizeof(double));
      for (int i = 0; i < 4; ++i) by[1][5 * i] = -kCs[i] / kDtS;
    }
    if (by[2] != nullptr) {
      std::memset(by[2], 0, 16 * sizeof(double));
      by[2][0] = kCs[0] * v[0] / p[0];
      by[2][3] = -kCs[0] * v[1];
      by[2][4] = kCs[1] * v[1] / p[0];
      by[2][7] = kCs[1] * v[0];
      by[2][9] = kCs[2] * (*u_)[3];
      by[2][14] = kCs[3] * (*u_)[2];
    }
    return true;
  }

 private:
  const Vec4* u_;
};

Vec4 Next(const Vec4& s, const Vec4& u, const Vec4& p) {
  const Vec4 v = Velocity(s.data(), u, p.data());
  return {s[0] + kDtS * v[0], s[1] + kDtS * v[1], s[2] + kDtS * v[2], s[3] + kDtS * v[3]};
}

}  // namespace

int main(int argc, char** argv) {
  google::InitGoogleLogging(argv[0]);
  std::FILE* file = argc == 6 ? std::fopen(argv[1], "r") : nullptr;
  int windows = 0, steps = 0;
  if (file == nullptr || std::fscanf(file, "%d %d", &windows, &steps) != 2 || steps < 2) {
    std::fprintf(stderr, "usage: mhe_ceres FILE cold|warm FUNCTION_TOLERANCE SOLVER RADIUS\n");
    return 2;
  }
  const bool is_warm = std::strcmp(argv[2], "warm") == 0;

  std::vector<Vec4> s(steps + 1), u(steps), o(steps);
  Vec4 p = kPrior;
  ceres::Problem::Options fast;
  fast.disable_all_safety_checks = true;
  ceres::Problem problem(fast);
  problem.AddResidualBlock(new Prior, nullptr, p.data());
  for (int k = 0; k < steps; ++k) {
    problem.AddResidualBlock(new Observation(&o[k]), new ceres::HuberLoss(1.0), s[k + 1].data());
    problem.AddResidualBlock(new Transition(&u[k]), nullptr, s[k].data(), s[k + 1].data(), p.data());
  }
  problem.SetParameterBlockConstant(s[0].data());

  ceres::Solver::Options options;
  if (!ParseOptions(argv + 3, &options)) return 2;

  for (int window = 0; window < windows; ++window) {
    bool is_whole = Read(file, &s[0]);
    for (int k = 0; k < steps; ++k) is_whole = is_whole && Read(file, &u[k]) && Read(file, &o[k]);
    if (!is_whole) {
      std::fprintf(stderr, "window %d is not whole\n", window);
      return 2;
    }
    if (is_warm && window > 0) {
      for (int k = 1; k < steps; ++k) s[k] = s[k + 1];
      s[steps] = Next(s[steps - 1], u[steps - 1], p);
    } else {
      p = kPrior;
      for (int k = 0; k < steps; ++k) s[k + 1] = Next(s[k], u[k], p);
    }
    SolveTimed(options, &problem);
    std::printf("\n");
  }
  return 0;
}
