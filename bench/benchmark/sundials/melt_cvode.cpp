#include "bench/benchmark/sundials/melt_cvode.hpp"

#include <cvode/cvode.h>
#include <fmt/format.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_band.h>
#include <sunmatrix/sunmatrix_band.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace meltbench::referee {
namespace {

using Row = std::array<double, 5>;  // Nodes i-2 ... i+2.

/// Weights w of f^(order)(at) = Σ w_j f(x_j); Fornberg, Math. Comp. 51 (1988) 699.
std::vector<double> fornberg(std::span<const double> x, double at, int order) {
  const std::size_t n = x.size();
  std::vector<std::array<double, 3>> c(n, {0.0, 0.0, 0.0});
  c[0][0] = 1.0;
  double c1 = 1.0;
  for (std::size_t i = 1; i < n; ++i) {
    double c2 = 1.0;
    const std::array<double, 3> last = c[i - 1];
    for (std::size_t j = 0; j < i; ++j) {
      const double c3 = x[i] - x[j];
      c2 *= c3;
      for (int m = 2; m >= 0; --m) {
        const auto k = static_cast<std::size_t>(m);
        c[j][k] = ((x[i] - at) * c[j][k] - (m > 0 ? m * c[j][k - 1] : 0.0)) / c3;
      }
    }
    for (int m = 2; m >= 0; --m) {
      const auto k = static_cast<std::size_t>(m);
      c[i][k] = c1 / c2 * ((m > 0 ? m * last[k - 1] : 0.0) - (x[i - 1] - at) * last[k]);
    }
    c1 = c2;
  }
  std::vector<double> w;
  for (const auto& row : c) w.push_back(row[static_cast<std::size_t>(order)]);
  return w;
}

std::vector<double> graded(std::size_t cells, double end_cell, double growth) {
  const auto width = [&](std::size_t i, double largest) {
    return std::min(largest, end_cell * std::pow(growth, static_cast<double>(std::min(i, cells - 1 - i))));
  };
  const auto total = [&](double largest) {
    double sum = 0.0;
    for (std::size_t i = 0; i < cells; ++i) sum += width(i, largest);
    return sum;
  };
  while (total(1.0) < 1.0) growth *= 1.005;
  double low = 0.0, high = 1.0;
  for (int i = 0; i < 100; ++i) (total(0.5 * (low + high)) > 1.0 ? high : low) = 0.5 * (low + high);
  const double sum = total(low);
  std::vector<double> x{0.0};
  for (std::size_t i = 0; i < cells; ++i) x.push_back(x.back() + width(i, low) / sum);
  x.back() = 1.0;
  return x;
}

void require(int flag, const char* what) {
  if (flag < 0) throw std::runtime_error(fmt::format("CVODE: {} returned {}", what, flag));
}

}  // namespace

/// y = [T_0 ... T_{N-1}, s, Tl_1 ... Tl_M]: the front sits between its two phases.
struct MeltCvode::State {
  plant::MeltParameters p;
  double T_b;
  Settings settings;
  double b = 0.0;
  plant::MeltInlet inlet;

  std::size_t N, M, size;
  std::vector<double> xi, eta;
  std::vector<Row> first_s, second_s, first_l, second_l;
  double row0_slope = 0.0, row1_first_slope = 0.0, row1_second_slope = 0.0, last_slope = 0.0;
  std::vector<double> front_s, front_l;

  // Rank-two part of the Jacobian: moving ⊗ speed_gradient + at_front ⊗ e_s; and both columns solved by the band.
  std::vector<double> moving, at_front, speed_gradient, solved_moving, solved_at_front;
  std::array<double, 4> small_inverse{};
  double gamma = 0.0;

  SUNContext context = nullptr;
  N_Vector y = nullptr, tolerance = nullptr, work = nullptr;
  SUNMatrix band = nullptr;
  SUNLinearSolver inner = nullptr, outer = nullptr;
  void* cvode = nullptr;
  bool initialised = false;
  double t = 0.0;

  State(const plant::MeltParameters& parameters, double T_barrel, const Settings& wanted);
  ~State();
  State(const State&) = delete;
  State& operator=(const State&) = delete;

  double* data() const { return N_VGetArrayPointer(y); }
  double q_f(double T0) const { return std::clamp(inlet.wanted_W_per_m2(T0), inlet.min_W_per_m2, inlet.max_W_per_m2); }
  void calc_rows(const double* Y, double* rate, bool with_jacobian);
};

MeltCvode::State::State(const plant::MeltParameters& parameters, double T_barrel, const Settings& wanted)
    : p{parameters},
      T_b{T_barrel},
      settings{wanted},
      N{wanted.solid_cells},
      M{wanted.liquid_cells},
      size{N + M + 1},
      first_s(N),
      second_s(N),
      first_l(M + 1),
      second_l(M + 1),
      moving(size),
      at_front(size),
      speed_gradient(size),
      solved_moving(size),
      solved_at_front(size) {
  const auto end = [&](const plant::MeltPhase& phase) {
    return settings.end_cell * phase.diffusivity_m2_per_s() / settings.grid_speed_m_per_s / (0.5 * p.length_m);
  };
  xi = graded(N, std::min(end(p.solid), 1.0 / static_cast<double>(N)), settings.growth);
  eta = graded(M, std::min(end(p.liquid), 1.0 / static_cast<double>(M)), settings.growth);

  const auto put = [](Row& row, std::size_t i, std::size_t from, const std::vector<double>& w) {
    for (std::size_t j = 0; j < w.size(); ++j) row[from + j + 2 - i] = w[j];
  };
  const std::span<const double> x{xi}, e{eta};
  for (std::size_t i = 2; i < N; ++i) {
    put(first_s[i], i, i - 2, fornberg(x.subspan(i - 2, 4), x[i], 1));
    put(second_s[i], i, i - 2, fornberg(x.subspan(i - 2, std::min<std::size_t>(5, N + 3 - i)), x[i], 2));
  }
  // Rows 0 and 1 take the slope as a datum: the cubic T0 + G x + (c2 + c3 x) x² through T1 and T2.
  const auto cubic = [&](double at, int order, Row& row, std::size_t i) {
    double slope = order == 1 ? 1.0 : 0.0;
    const double d = x[2] - x[1];
    // r(x) = r1 (x2 - x)/d + r2 (x - x1)/d;  T' = G + 2x r + x² r',  T'' = 2r + 4x r'.
    const double r1 = (x[2] - at) / d, r2 = (at - x[1]) / d;
    const double w1 = order == 1 ? 2.0 * at * r1 - at * at / d : 2.0 * r1 - 4.0 * at / d;
    const double w2 = order == 1 ? 2.0 * at * r2 + at * at / d : 2.0 * r2 + 4.0 * at / d;
    row[3 - i] += w1 / (x[1] * x[1]);
    row[4 - i] += w2 / (x[2] * x[2]);
    row[2 - i] -= w1 / (x[1] * x[1]) + w2 / (x[2] * x[2]);
    slope -= w1 / x[1] + w2 / x[2];
    return slope;
  };
  row0_slope = cubic(0.0, 2, second_s[0], 0);
  row1_first_slope = cubic(x[1], 1, first_s[1], 1);
  row1_second_slope = cubic(x[1], 2, second_s[1], 1);
  front_s = fornberg(x.subspan(N - 5), 1.0, 1);

  put(first_l[1], 1, 0, fornberg(e.subspan(0, 4), e[1], 1));
  put(second_l[1], 1, 0, fornberg(e.subspan(0, 4), e[1], 2));
  for (std::size_t j = 2; j < M; ++j) {
    put(first_l[j], j, j - 2, fornberg(e.subspan(j - 2, 4), e[j], 1));
    put(second_l[j], j, j - 2, fornberg(e.subspan(j - 2, std::min<std::size_t>(5, M + 3 - j)), e[j], 2));
  }
  // Nozzle: parabola through T_{M-1}, T_M with the given slope.
  const double d = e[M] - e[M - 1];
  second_l[M][1] = 2.0 / (d * d);
  second_l[M][2] = -2.0 / (d * d);
  last_slope = 2.0 / d;
  front_l = fornberg(e.subspan(0, 4), 0.0, 1);
}

/// Right side of the method of lines; with_jacobian also fills the band matrix and the rank-two part.
void MeltCvode::State::calc_rows(const double* Y, double* rate, bool with_jacobian) {
  const double s = Y[N], l = p.length_m - s, T_m = p.T_melt_degC;
  const double k_s = p.solid.conductivity_W_per_mK, k_l = p.liquid.conductivity_W_per_mK;
  const double beta = p.front_speed_per_flux_m3_per_J();
  const auto solid = [&](std::size_t i) { return i < N ? Y[i] : T_m; };
  const auto liquid = [&](std::size_t j) { return j > 0 ? Y[N + j] : T_m; };

  double slope_s = 0.0, slope_l = 0.0;
  for (std::size_t j = 0; j < 6; ++j) slope_s += front_s[j] * solid(N - 5 + j);
  for (std::size_t j = 0; j < 4; ++j) slope_l += front_l[j] * liquid(j);
  const double speed = beta * (k_s * slope_s / s - k_l * slope_l / l);

  const double q = q_f(Y[0]);
  const double G = -q / k_s;
  const double G_T = q == inlet.wanted_W_per_m2(Y[0]) ? inlet.gain_W_per_m2K / k_s : 0.0;
  if (with_jacobian) {
    SUNMatZero(band);
    std::fill(speed_gradient.begin(), speed_gradient.end(), 0.0);
    for (std::size_t j = 0; j < 5; ++j) speed_gradient[N - 5 + j] = beta * k_s * front_s[j] / s;
    for (std::size_t j = 1; j < 4; ++j) speed_gradient[N + j] = -beta * k_l * front_l[j] / l;
    speed_gradient[N] = -beta * (k_s * slope_s / (s * s) + k_l * slope_l / (l * l));
    moving[N] = 1.0;
    at_front[N] = 0.0;
  }
  const auto add = [&](std::size_t row, std::size_t column, double value) {
    SM_ELEMENT_B(band, static_cast<sunindextype>(row), static_cast<sunindextype>(column)) += value;
  };

  {
    const double alpha = p.solid.diffusivity_m2_per_s(), h = p.solid.exchange_rate_1_per_s();
    for (std::size_t i = 0; i < N; ++i) {
      double first = 0.0, second = 0.0;
      for (std::size_t k = i < 2 ? 2 - i : 0; k < 5 && i + k - 2 <= N; ++k) {
        first += first_s[i][k] * solid(i + k - 2);
        second += second_s[i][k] * solid(i + k - 2);
      }
      const double of_first = i == 0 ? 1.0 : i == 1 ? row1_first_slope : 0.0;
      const double of_second = i == 0 ? row0_slope : i == 1 ? row1_second_slope : 0.0;
      first += of_first * s * G;
      second += of_second * s * G;
      const double w = b - xi[i] * speed;
      rate[i] = alpha / (s * s) * second - w / s * first + h * (T_b - Y[i]);
      if (!with_jacobian) continue;
      for (std::size_t k = i < 2 ? 2 - i : 0; k < 5 && i + k - 2 < N; ++k) {
        add(i, i + k - 2, alpha / (s * s) * second_s[i][k] - w / s * first_s[i][k]);
      }
      add(i, i, -h);
      add(i, 0, (alpha / s * of_second - w * of_first) * G_T);
      moving[i] = xi[i] / s * first;
      at_front[i] = -2.0 * alpha / (s * s * s) * second + w / (s * s) * first +
                    (alpha / (s * s) * of_second - w / s * of_first) * G;
    }
  }
  rate[N] = speed;
  {
    const double alpha = p.liquid.diffusivity_m2_per_s(), h = p.liquid.exchange_rate_1_per_s();
    const double q_m = p.nozzle_flux_W_per_m2 / k_l;
    for (std::size_t j = 1; j <= M; ++j) {
      double first = j == M ? l * q_m : 0.0, second = j == M ? last_slope * l * q_m : 0.0;
      for (std::size_t k = j < 2 ? 2 - j : 0; k < 5 && j + k - 2 <= M; ++k) {
        first += first_l[j][k] * liquid(j + k - 2);
        second += second_l[j][k] * liquid(j + k - 2);
      }
      const double w = b - (1.0 - eta[j]) * speed;
      rate[N + j] = alpha / (l * l) * second - w / l * first + h * (T_b - Y[N + j]);
      if (!with_jacobian) continue;
      for (std::size_t k = 0; k < 5; ++k) {
        if (j + k < 3 || j + k - 2 > M) continue;
        add(N + j, N + j + k - 2, alpha / (l * l) * second_l[j][k] - w / l * first_l[j][k]);
      }
      add(N + j, N + j, -h);
      moving[N + j] = (1.0 - eta[j]) / l * first;
      const double known = j == M ? alpha / (l * l) * last_slope * q_m - w / l * q_m : 0.0;
      at_front[N + j] = 2.0 * alpha / (l * l * l) * second - w / (l * l) * first - known;
    }
  }
}

/// What CVODE calls; it knows State.
struct MeltCvode::Hooks {
  static State& of(void* user) { return *static_cast<State*>(user); }

  static int rate(realtype, N_Vector y, N_Vector rate, void* user) {
    of(user).calc_rows(N_VGetArrayPointer(y), N_VGetArrayPointer(rate), false);
    return std::isfinite(N_VGetArrayPointer(rate)[of(user).N]) ? 0 : 1;
  }
  static int jacobian(realtype, N_Vector y, N_Vector, SUNMatrix matrix, void* user, N_Vector, N_Vector, N_Vector) {
    State& state = of(user);
    std::swap(state.band, matrix);
    state.calc_rows(N_VGetArrayPointer(y), N_VGetArrayPointer(state.work), true);
    std::swap(state.band, matrix);
    return 0;
  }

  static SUNLinearSolver_Type type(SUNLinearSolver) { return SUNLINEARSOLVER_DIRECT; }
  static int initialize(SUNLinearSolver solver) { return SUNLinSolInitialize(of(solver->content).inner); }
  static int setup(SUNLinearSolver solver, SUNMatrix matrix) {
    State& state = of(solver->content);
    const int flag = SUNLinSolSetup(state.inner, matrix);
    if (flag != 0) return flag;
    CVodeGetCurrentGamma(state.cvode, &state.gamma);
    band_solve(state, matrix, state.moving, state.solved_moving);
    band_solve(state, matrix, state.at_front, state.solved_at_front);
    // M = B - γ U V^T with V^T = [speed_gradient; e_s]:  M^-1 = B^-1 + B^-1 U (I/γ - V^T B^-1 U)^-1 V^T B^-1.
    const double a = 1.0 / state.gamma - dot(state.speed_gradient, state.solved_moving);
    const double c = -dot(state.speed_gradient, state.solved_at_front);
    const double d = -state.solved_moving[state.N];
    const double e = 1.0 / state.gamma - state.solved_at_front[state.N];
    const double determinant = a * e - c * d;
    state.small_inverse = {e / determinant, -c / determinant, -d / determinant, a / determinant};
    return 0;
  }
  static int solve(SUNLinearSolver solver, SUNMatrix matrix, N_Vector x, N_Vector right, realtype tolerance) {
    State& state = of(solver->content);
    const int flag = SUNLinSolSolve(state.inner, matrix, x, right, tolerance);
    if (flag != 0) return flag;
    double* z = N_VGetArrayPointer(x);
    double along_speed = 0.0;
    for (std::size_t i = 0; i < state.size; ++i) along_speed += state.speed_gradient[i] * z[i];
    const double at_s = z[state.N];
    const double u = state.small_inverse[0] * along_speed + state.small_inverse[1] * at_s;
    const double v = state.small_inverse[2] * along_speed + state.small_inverse[3] * at_s;
    for (std::size_t i = 0; i < state.size; ++i) z[i] += u * state.solved_moving[i] + v * state.solved_at_front[i];
    return 0;
  }
  static int free(SUNLinearSolver solver) {
    solver->content = nullptr;
    SUNLinSolFreeEmpty(solver);
    return 0;
  }

 private:
  static double dot(const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
  }
  static void band_solve(State& state, SUNMatrix matrix, const std::vector<double>& right, std::vector<double>& x) {
    std::copy(right.begin(), right.end(), N_VGetArrayPointer(state.work));
    SUNLinSolSolve(state.inner, matrix, state.work, state.work, 0.0);
    std::copy_n(N_VGetArrayPointer(state.work), x.size(), x.begin());
  }
};

MeltCvode::State::~State() {
  if (cvode != nullptr) CVodeFree(&cvode);
  if (outer != nullptr) SUNLinSolFree(outer);
  if (inner != nullptr) SUNLinSolFree(inner);
  if (band != nullptr) SUNMatDestroy(band);
  for (N_Vector vector : {y, tolerance, work}) {
    if (vector != nullptr) N_VDestroy(vector);
  }
  if (context != nullptr) SUNContext_Free(&context);
}

MeltCvode::MeltCvode(const plant::MeltParameters& parameters, double T_barrel_degC, const Settings& settings)
    : state_{std::make_unique<State>(parameters, T_barrel_degC, settings)} {
  State& state = *state_;
  require(SUNContext_Create(nullptr, &state.context), "SUNContext_Create");
  const auto size = static_cast<sunindextype>(state.size);
  state.y = N_VNew_Serial(size, state.context);
  state.tolerance = N_VNew_Serial(size, state.context);
  state.work = N_VNew_Serial(size, state.context);
  N_VConst(settings.absolute_tolerance_K, state.tolerance);
  N_VGetArrayPointer(state.tolerance)[state.N] = 1e-6 * settings.absolute_tolerance_K;
  state.band = SUNBandMatrix(size, 2, 2, state.context);
  state.inner = SUNLinSol_Band(state.y, state.band, state.context);
  state.outer = SUNLinSolNewEmpty(state.context);
  state.outer->content = &state;
  state.outer->ops->gettype = Hooks::type;
  state.outer->ops->initialize = Hooks::initialize;
  state.outer->ops->setup = Hooks::setup;
  state.outer->ops->solve = Hooks::solve;
  state.outer->ops->free = Hooks::free;
  state.cvode = CVodeCreate(CV_BDF, state.context);
  start_linear(0.5 * parameters.length_m, parameters.T_melt_degC);
  require(CVodeInit(state.cvode, Hooks::rate, 0.0, state.y), "CVodeInit");
  state.initialised = true;
  require(CVodeSVtolerances(state.cvode, settings.relative_tolerance, state.tolerance), "CVodeSVtolerances");
  require(CVodeSetUserData(state.cvode, &state), "CVodeSetUserData");
  require(CVodeSetLinearSolver(state.cvode, state.outer, state.band), "CVodeSetLinearSolver");
  require(CVodeSetJacFn(state.cvode, Hooks::jacobian), "CVodeSetJacFn");
  require(CVodeSetMaxNumSteps(state.cvode, 1000000), "CVodeSetMaxNumSteps");
}

MeltCvode::~MeltCvode() = default;

void MeltCvode::start_linear(double front_m, double T_inlet_degC) {
  State& state = *state_;
  double* y = state.data();
  const double T_m = state.p.T_melt_degC;
  const double slope = state.p.nozzle_flux_W_per_m2 / state.p.liquid.conductivity_W_per_mK;
  for (std::size_t i = 0; i < state.N; ++i) y[i] = T_inlet_degC + (T_m - T_inlet_degC) * state.xi[i];
  y[state.N] = front_m;
  for (std::size_t j = 1; j <= state.M; ++j) y[state.N + j] = T_m + slope * (state.p.length_m - front_m) * state.eta[j];
  state.t = 0.0;
  restart();
}

void MeltCvode::start_steady(const plant::MeltSteadyState& steady) {
  State& state = *state_;
  double* y = state.data();
  for (std::size_t i = 0; i < state.N; ++i) y[i] = steady.T_solid_degC(steady.front_m * state.xi[i]);
  y[state.N] = steady.front_m;
  for (std::size_t j = 1; j <= state.M; ++j) {
    y[state.N + j] = steady.T_liquid_degC(steady.front_m + (steady.length_m - steady.front_m) * state.eta[j]);
  }
  state.t = 0.0;
  restart();
}

void MeltCvode::restart() {
  if (state_->initialised) CVodeReInit(state_->cvode, state_->t, state_->y);
}

void MeltCvode::advance_to(double t_s, double speed_m_per_s, const plant::MeltInlet& inlet) {
  State& state = *state_;
  if (!(t_s > state.t)) return;
  state.b = speed_m_per_s;
  state.inlet = inlet;
  require(CVodeSetStopTime(state.cvode, t_s), "CVodeSetStopTime");
  require(CVode(state.cvode, t_s, state.y, &state.t, CV_NORMAL), "CVode");
}

double MeltCvode::front_m() const {
  return state_->data()[state_->N];
}
double MeltCvode::T_inlet_degC() const {
  return state_->data()[0];
}
double MeltCvode::inlet_flux_W_per_m2() const {
  return state_->q_f(state_->data()[0]);
}
std::span<const double> MeltCvode::solid_nodes() const {
  return state_->xi;
}
std::span<const double> MeltCvode::solid_T_degC() const {
  return {state_->data(), state_->N};
}
long MeltCvode::step_count() const {
  long steps = 0;
  CVodeGetNumSteps(state_->cvode, &steps);
  return steps;
}

}  // namespace meltbench::referee
