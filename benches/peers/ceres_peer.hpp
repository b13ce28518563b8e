// What the peers that solve a row of small problems share: vectors, their text, options and the clock.
//
// Owns nothing of a problem.

#pragma once

#include <ceres/ceres.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstdlib>

using Vec4 = std::array<double, 4>;

constexpr double kDtS = 0.02;

inline bool Read(std::FILE* file, Vec4* v) {
  return std::fscanf(file, "%lf %lf %lf %lf", &(*v)[0], &(*v)[1], &(*v)[2], &(*v)[3]) == 4;
}

// `FUNCTION_TOLERANCE SOLVER RADIUS` of a command line; false, with a line that says so, without such a solver.
inline bool ParseOptions(char** arguments, ceres::Solver::Options* options) {
  if (!ceres::StringToLinearSolverType(arguments[1], &options->linear_solver_type)) {
    std::fprintf(stderr, "no linear solver %s\n", arguments[1]);
    return false;
  }
  options->function_tolerance = std::atof(arguments[0]);
  options->gradient_tolerance = 0.0;
  options->parameter_tolerance = 0.0;
  options->initial_trust_region_radius = std::atof(arguments[2]);
  options->max_num_iterations = 100;
  options->logging_type = ceres::SILENT;
  return true;
}

// Solves and prints time in ns, iterations and cost, without the end of the line.
inline void SolveTimed(const ceres::Solver::Options& options, ceres::Problem* problem) {
  ceres::Solver::Summary summary;
  const auto start = std::chrono::steady_clock::now();
  ceres::Solve(options, problem, &summary);
  const auto end = std::chrono::steady_clock::now();
  const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(end - start).count();
  const int iterations = summary.num_successful_steps + summary.num_unsuccessful_steps - 1;
  std::printf("%lld %d %.17g", static_cast<long long>(ns), iterations, summary.final_cost);
}
