// The same filter in C++ with fixed-size Eigen matrices: dense UKF (alpha 1, beta 2, kappa 0, points redrawn) of a
// coordinated turn seen in range and bearing. Usage: ukf MEASUREMENTS.bin ROWS MEANS.bin; writes the filtered means and
// prints the seconds of the filter alone.
#include <Eigen/Dense>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

constexpr int N = 5, M = 2, P = 2 * N + 1;
using State = Eigen::Matrix<double, N, 1>;
using Measurement = Eigen::Matrix<double, M, 1>;
using StateCov = Eigen::Matrix<double, N, N>;
using MeasurementCov = Eigen::Matrix<double, M, M>;
using Cross = Eigen::Matrix<double, N, M>;
using States = Eigen::Matrix<double, N, P>;

static inline State f(const State& x) {
  const double w = x[4], s = std::sin(w), c = std::cos(w);
  State next;
  next << x[0] + s / w * x[1] - (1 - c) / w * x[3], c * x[1] - s * x[3], x[2] + (1 - c) / w * x[1] + s / w * x[3],
      s * x[1] + c * x[3], w;
  return next;
}

static inline Measurement h(const State& x) {
  Measurement y;
  y << std::hypot(x[0], x[2]), std::atan2(x[2], x[0]);
  return y;
}

static inline void draw(const State& x, const StateCov& cov, double spread, States& points) {
  const StateCov L = spread * StateCov(cov.llt().matrixL());
  points.col(0) = x;
  for (int i = 0; i < N; i++) {
    points.col(1 + i) = x + L.col(i);
    points.col(1 + N + i) = x - L.col(i);
  }
}

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  const long rows = std::atol(argv[2]);
  std::vector<double> y(M * rows), means(N * rows), stds(N * rows);
  FILE* file = std::fopen(argv[1], "rb");
  if (!file || std::fread(y.data(), sizeof(double), M * rows, file) != size_t(M * rows)) return 1;
  std::fclose(file);

  const double alpha = 1, beta = 2, kappa = 0, lambda = alpha * alpha * (N + kappa) - N;
  const double spread = std::sqrt(N + lambda), w = 0.5 / (N + lambda), wm = lambda / (N + lambda);
  const double wc = wm + 1 - alpha * alpha + beta;
  StateCov Q = StateCov::Zero();
  for (int i : {0, 2}) {
    Q(i, i) = 0.1 / 3;
    Q(i, i + 1) = Q(i + 1, i) = 0.1 / 2;
    Q(i + 1, i + 1) = 0.1;
  }
  Q(4, 4) = 1e-6;
  MeasurementCov R = MeasurementCov::Zero();
  R.diagonal() << 100, 1e-5;

  const auto begin = std::chrono::steady_clock::now();
  State x;
  x << 1000, 30, 1000, 0, 0.05;
  StateCov C = StateCov::Zero();
  C.diagonal() << 100, 10, 100, 10, 1e-4;
  States X;
  Eigen::Matrix<double, M, P> Y;
  double log_likelihood = 0;
  for (long t = 0; t < rows; t++) {
    draw(x, C, spread, X);
    for (int i = 0; i < P; i++) Y.col(i) = h(X.col(i));
    Measurement mean = wm * Y.col(0);
    for (int i = 1; i < P; i++) mean += w * Y.col(i);
    MeasurementCov S = R;
    Cross cross = Cross::Zero();
    for (int i = 0; i < P; i++) {
      const Measurement d = Y.col(i) - mean;
      S += (i ? w : wc) * d * d.transpose();
      cross += (i ? w : wc) * (X.col(i) - x) * d.transpose();
    }
    const Measurement e(y[M * t] - mean[0], y[M * t + 1] - mean[1]);
    const MeasurementCov inverse = S.inverse();
    const Cross K = cross * inverse;
    x += K * e;
    C -= K * S * K.transpose();
    C = (0.5 * (C + C.transpose())).eval();
    log_likelihood += -0.5 * (e.dot(inverse * e) + std::log(S.determinant()) + M * std::log(2 * M_PI));
    for (int i = 0; i < N; i++) {
      means[N * t + i] = x[i];
      stds[N * t + i] = std::sqrt(C(i, i));
    }
    draw(x, C, spread, X);
    for (int i = 0; i < P; i++) X.col(i) = f(X.col(i));
    State ahead = wm * X.col(0);
    for (int i = 1; i < P; i++) ahead += w * X.col(i);
    C = Q;
    for (int i = 0; i < P; i++) {
      const State d = X.col(i) - ahead;
      C += (i ? w : wc) * d * d.transpose();
    }
    x = ahead;
  }
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  file = std::fopen(argv[3], "wb");
  if (!file || std::fwrite(means.data(), sizeof(double), means.size(), file) != means.size() || std::fclose(file))
    return 1;
  std::printf("%.9f %.10e\n", seconds, log_likelihood);
}
