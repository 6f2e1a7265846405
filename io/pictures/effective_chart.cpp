// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/effective_chart.hpp"

#include "efree/io/pictures/internal/gnuplot.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

namespace efree {
namespace {

struct ImagePlane {
  const char* name;
  int first, second;
};
constexpr std::array<ImagePlane, 3> planes{{{"xy", 0, 1}, {"xz", 0, 2}, {"yz", 1, 2}}};

}  // namespace

std::string draw_directions(OutputDirectory& out, EffectiveProperty property, const EffectiveResult& result) {
  for (const char* old : {"directions.svg", "directions.png", "charts.gp"}) out.supersede(old);
  const bool is_elastic = property == EffectiveProperty::stiffness;
  if (result.inverse.size() == 0) return "no chart of directions: the tensor is singular";
  const auto value = [&](const Vec<3>& n) {
    const Vector there = n.head(result.dim);
    if (!is_elastic) return there.dot(Vector(result.tensor.tensor * there));
    return result.dim == 2 ? plane_youngs_modulus(result.inverse, n.head<2>())
                           : youngs_modulus(ElasticTensor(result.inverse), n);
  };
  std::string script = "# Young's modulus or conductivity by direction; run with: gnuplot charts.gp\n";
  double largest = 0.0;
  const std::size_t count = result.dim == 2 ? 1 : planes.size();
  for (const ImagePlane& plane : std::span(planes).first(count)) {
    script += fmt::format("${} << EOD\n", plane.name);
    for (int degree = 0; degree <= 360; degree += 2) {
      const double angle = degree * std::numbers::pi / 180.0;
      Vec<3> n = Vec<3>::Zero();
      n[plane.first] = std::cos(angle);
      n[plane.second] = std::sin(angle);
      const double radius = value(n);
      largest = std::max(largest, radius);
      script += fmt::format("{:.8g} {:.8g}\n", radius * n[plane.first], radius * n[plane.second]);
    }
    script += "EOD\n";
  }
  constexpr std::array<const char*, 3> colours{"#0072B2", "#D55E00", "#009E73"};  // Okabe & Ito 2008
  script += "do for [type in 'svg png'] {\nreset\n" + internal::chart_style(420 * static_cast<int>(count), 470);
  script +=
      fmt::format("set output 'directions.'.type\nset multiplot layout 1,{}\nset size square\nunset key\n", count);
  script += fmt::format("set xrange [{0:.6g}:{1:.6g}]\nset yrange [{0:.6g}:{1:.6g}]\n", -1.1 * largest, 1.1 * largest);
  script += "set xtics rotate by -30\n";
  for (std::size_t p = 0; p < count; ++p)
    script += fmt::format(
        "set title '{}, plane {}'\nset xlabel '{}'\nset ylabel '{}'\nplot ${} using 1:2 with lines lw 2.5 lc rgb "
        "'{}'\n",
        is_elastic ? "Young''s modulus" : "conductivity", planes[p].name, "xyz"[planes[p].first],
        "xyz"[planes[p].second], planes[p].name, colours[p]);
  return internal::draw_with_gnuplot(out, script + "unset multiplot\nset output\n}\n", {"directions"});
}

}  // namespace efree
