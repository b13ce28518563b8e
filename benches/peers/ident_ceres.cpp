// Maximum a posteriori identification of thesis equation 4.1 with Ceres: the peer of `tello-ctl ident`.
//
// Owns the problem as a user of Ceres would write it: one residual block per observation, transition and
// prior, derivatives by automatic differentiation, sparse Cholesky factorization of the normal equations.
// It shares no code with tello-ctl, so that it also checks the result.
//
//   ident_ceres FOLDER THREADS FUNCTION_TOLERANCE
//
// FOLDER holds CSV logs (`tag,step,v1,v2,v3,v4` with the tags `pos` and `input`) whose inputs are already
// shifted by the dead time. Prints one JSON object.

#include <ceres/ceres.h>
#include <glog/logging.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

using Vec4 = std::array<double, 4>;

constexpr double kDtS = 0.02;
// Weights multiply residuals. States: x, y, z, theta. Parameter: lambda_h, lambda_v, lambda_a, theta_0.
constexpr Vec4 kCo = {3.0, 3.0, 2.0, 0.3};
constexpr Vec4 kCs = {1.0, 1.0, 0.1, 0.3};
constexpr Vec4 kCp = {1.0, 1.0, 1.0, 1.0};
constexpr Vec4 kPrior = {0.9, 0.6, 0.9, 0.0};

struct Piece {
  std::vector<Vec4> o;  // observations
  std::vector<Vec4> u;  // acting inputs: roll, pitch, yaw, throttle
};

// C_p (p - p_prior)
struct Prior {
  template <typename T>
  bool operator()(const T* p, T* r) const {
    for (int i = 0; i < 4; ++i) r[i] = kCp[i] * (p[i] - kPrior[i]);
    return true;
  }
};

// C_o (s_k - o_k)
struct Observation {
  Vec4 o;
  template <typename T>
  bool operator()(const T* s, T* r) const {
    for (int i = 0; i < 4; ++i) r[i] = kCo[i] * (s[i] - o[i]);
    return true;
  }
};

// C_s ((s_k - s_{k+1}) / dt + f(s_k, u_k, p))
struct Transition {
  Vec4 u;
  template <typename T>
  bool operator()(const T* s, const T* s_next, const T* p, T* r) const {
    using std::cos;
    using std::sin;
    const auto [roll, pitch, yaw, throttle] = u;
    const T psi = s[3] + p[3];
    const T c = cos(psi), d = sin(psi);
    const T velocity[4] = {p[0] * (d * roll + c * pitch), p[0] * (d * pitch - c * roll), p[1] * throttle,
                           p[2] * yaw};
    for (int i = 0; i < 4; ++i) r[i] = kCs[i] * ((s[i] - s_next[i]) / kDtS + velocity[i]);
    return true;
  }
};

Piece ReadPiece(const std::filesystem::path& path) {
  Piece piece;
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line)) {
    const bool is_pos = line.rfind("pos,", 0) == 0;
    if (!is_pos && line.rfind("input,", 0) != 0) continue;
    const char* at = std::strchr(line.c_str(), ',');
    at = std::strchr(at + 1, ',');  // past the step
    Vec4 v{};
    int count = 0;
    for (; count < 4 && at != nullptr; ++count) {
      char* end = nullptr;
      v[count] = std::strtod(at + 1, &end);
      at = *end == ',' ? end : nullptr;
    }
    if (count != 4) {
      std::fprintf(stderr, "%s: %s\n", path.c_str(), line.c_str());
      std::exit(2);
    }
    (is_pos ? piece.o : piece.u).push_back(v);
  }
  return piece;
}

std::vector<Piece> ReadFolder(const char* folder) {
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  std::vector<Piece> pieces;
  for (const auto& path : paths) pieces.push_back(ReadPiece(path));
  return pieces;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: %s FOLDER THREADS FUNCTION_TOLERANCE\n", argv[0]);
    return 2;
  }
  google::InitGoogleLogging(argv[0]);
  const std::vector<Piece> pieces = ReadFolder(argv[1]);

  Vec4 p = kPrior;
  ceres::Problem::Options unchecked;
  unchecked.disable_all_safety_checks = true;
  ceres::Problem problem(unchecked);
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Prior, 4, 4>(new Prior), nullptr, p.data());
  std::vector<std::vector<Vec4>> states;
  for (const Piece& piece : pieces) {
    states.push_back(piece.o);  // start: states are observations
    std::vector<Vec4>& s = states.back();
    for (size_t k = 0; k < s.size(); ++k) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Observation, 4, 4>(new Observation{piece.o[k]}), nullptr,
          s[k].data());
    }
    for (size_t k = 0; k + 1 < s.size(); ++k) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Transition, 4, 4, 4, 4>(new Transition{piece.u[k]}), nullptr,
          s[k].data(), s[k + 1].data(), p.data());
    }
  }

  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  options.num_threads = std::atoi(argv[2]);
  options.function_tolerance = std::atof(argv[3]);
  // The other criteria stay out of the way: one tolerance decides.
  options.gradient_tolerance = 1e-14;
  options.parameter_tolerance = 1e-14;
  options.max_num_iterations = 200;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf(
      "{\"p\": [%.9g, %.9g, %.9g, %.9g], \"cost\": %.9g, \"iterations\": %zu, \"converged\": %s, "
      "\"solve_s\": %.4f, \"peak_mb\": %.1f, \"threads\": %d, \"unknowns\": %d}\n",
      p[0], p[1], p[2], p[3], summary.final_cost, summary.iterations.size() - 1,
      summary.termination_type == ceres::CONVERGENCE ? "true" : "false", summary.total_time_in_seconds,
      static_cast<double>(usage.ru_maxrss) / 1024.0, summary.num_threads_used, summary.num_parameters);
  return summary.termination_type == ceres::CONVERGENCE ? 0 : 1;
}
