// SPDX-License-Identifier: GPL-3.0-or-later
/// An analysis through time as a picture.
#include "efree/io/pictures/history_chart.hpp"

#include "efree/io/pictures/internal/canvas.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace efree {
namespace {

using internal::Canvas, internal::Colour;

struct Curve {
  std::string name;
  std::vector<double> values;  ///< by step, from nothing on
  double largest() const {
    double most = 0.0;
    for (const double value : values) most = std::max(most, std::abs(value));
    return most;
  }
};

/// Those that become largest, in their order; none that is rounding against them.
std::vector<Curve> largest_of(std::vector<Curve> curves) {
  constexpr std::size_t most = 8;
  std::vector<double> sizes;
  for (const Curve& curve : curves) sizes.push_back(curve.largest());
  std::ranges::sort(sizes, std::greater<>());
  if (sizes.empty()) return {};
  const double least = std::max(sizes[std::min(most, sizes.size()) - 1], 1e-8 * sizes.front());
  std::erase_if(curves, [&](const Curve& curve) { return !(curve.largest() >= least && curve.largest() > 0.0); });
  if (curves.size() > most) curves.resize(most);
  return curves;
}

/// An axis with round numbers.
struct Axis {
  double low, high, step;

  explicit Axis(const std::vector<double>& values) {
    const auto [least, most] = std::ranges::minmax(values);
    const double span = std::max(most - least, 1e-300);
    const double decade = std::pow(10.0, std::floor(std::log10(span / 4.0)));
    step = decade;
    for (const double factor : {2.0, 5.0, 10.0})
      if (span / step > 6.0) step = factor * decade;
    low = step * std::floor(least / step + 1e-9);
    high = step * std::ceil(most / step - 1e-9);
  }
  double share(double value) const { return (value - low) / (high - low); }
};

/// Curves over time in a part of the picture, their names beside them.
void draw_panel(Canvas& canvas, double bottom, double top, const std::string& title, const std::vector<double>& times,
                const std::vector<Curve>& curves) {
  // Okabe & Ito 2008, safe for the colour-blind.
  static const std::array<Colour, 8> colours{Colour(0.0F, 0.447F, 0.698F), Colour(0.835F, 0.369F, 0.0F),
                                             Colour(0.0F, 0.62F, 0.451F),  Colour(0.8F, 0.475F, 0.655F),
                                             Colour(0.902F, 0.624F, 0.0F), Colour(0.337F, 0.706F, 0.914F),
                                             Colour(0.35F, 0.35F, 0.35F),  Colour(0.6F, 0.5F, 0.1F)};
  constexpr double left = 170.0, right = 1180.0;
  const Colour frame = Colour::Constant(0.2F), grid = Colour::Constant(0.87F);
  std::vector<double> all{0.0};
  for (const Curve& curve : curves) all.insert(all.end(), curve.values.begin(), curve.values.end());
  const Axis x(times), y(all);
  const auto at = [&](double t, double value) {
    return Canvas::Position(left + x.share(t) * (right - left), bottom + y.share(value) * (top - bottom), 0.0);
  };
  const auto ticks = [](const Axis& axis) { return static_cast<int>(std::lround((axis.high - axis.low) / axis.step)); };
  const auto label = [](const Axis& axis, int k) {
    const double value = axis.low + k * axis.step;
    return fmt::format("{:.4g}", std::abs(value) < 1e-9 * axis.step ? 0.0 : value);
  };
  for (int k = 0; k <= ticks(x); ++k) {
    const double t = x.low + k * x.step;
    canvas.line(at(t, y.low), at(t, y.high), 1.0, grid);
    canvas.text(label(x, k), at(t, y.low).x() - 5.0 * static_cast<double>(label(x, k).size()), bottom - 38.0, 20);
  }
  for (int k = 0; k <= ticks(y); ++k) {
    const double value = y.low + k * y.step;
    canvas.line(at(x.low, value), at(x.high, value), 1.0, grid);
    canvas.text(label(y, k), left - 18.0 - 11.0 * static_cast<double>(label(y, k).size()), at(0.0, value).y() - 8.0,
                20);
  }
  canvas.begin_layer();
  canvas.line(at(x.low, y.low), at(x.high, y.low), 2.0, frame);
  canvas.line(at(x.low, y.low), at(x.low, y.high), 2.0, frame);
  canvas.text(title, left, top + 22.0, 24);
  for (std::size_t c = 0; c < curves.size(); ++c) {
    const Curve& curve = curves[c];
    for (std::size_t k = 1; k < times.size(); ++k)
      canvas.line(at(times[k - 1], curve.values[k - 1]), at(times[k], curve.values[k]), 3.0, colours[c]);
    const double row = top - 14.0 - 36.0 * static_cast<double>(c);
    canvas.line({right + 30.0, row, 0.0}, {right + 70.0, row, 0.0}, 4.0, colours[c]);
    constexpr std::size_t longest = 28;
    canvas.text(curve.name.size() <= longest ? curve.name : curve.name.substr(0, longest) + "...", right + 85.0,
                row - 8.0, 20);
  }
}

}  // namespace

template <int Dim> void draw_history(const std::filesystem::path& file, const Settings<Dim>& settings,
                                     const std::vector<HistoryStep<Dim>>& history) {
  std::vector<double> times{0.0};
  for (const auto& step : history) times.push_back(step.time);
  std::vector<Curve> reactions, probes;
  for (int i = 0; i < Dim; ++i) {
    for (const auto& [part, any] : history.front().reactions) {
      Curve& curve = reactions.emplace_back(Curve{fmt::format("{}, {}", part, "xyz"[i]), {0.0}});
      for (const auto& step : history) curve.values.push_back(step.reactions.at(part).force[i]);
    }
    for (std::size_t p = 0; p < settings.probes.size(); ++p) {
      Curve& curve = probes.emplace_back(Curve{fmt::format("{}, u{}", settings.probes[p].name, "xyz"[i]), {0.0}});
      for (const auto& step : history) curve.values.push_back(step.probes[p][i]);
    }
  }
  reactions = largest_of(std::move(reactions));
  probes = largest_of(std::move(probes));
  Canvas canvas;
  if (probes.empty()) {
    draw_panel(canvas, 110.0, 1100.0, "reactions over time", times, reactions);
  } else {
    draw_panel(canvas, 690.0, 1110.0, "reactions over time", times, reactions);
    draw_panel(canvas, 100.0, 540.0, "displacements of probes over time", times, probes);
  }
  canvas.save(file);
}

template void draw_history<2>(const std::filesystem::path&, const Settings<2>&, const std::vector<HistoryStep<2>>&);
template void draw_history<3>(const std::filesystem::path&, const Settings<3>&, const std::vector<HistoryStep<3>>&);

}  // namespace efree
