// SPDX-License-Identifier: GPL-3.0-or-later
/// The patch tests as a Markdown table: tension, shear and rotation on 20 random clouds for every body, condition and
/// secondary basis, held on the whole outer boundary and on one side only; largest error anywhere. The last rows show
/// what gradients evaluated at the quadrature points give instead of projected ones. Degree 2: quadratic fields, order
/// 2 on quadratic cells.
///
///   bench_patch_table [clouds = 20] [dimension = 2] [degree = 1]
#include "efree/tests/bodies.hpp"
#include "efree/tests/solids.hpp"

#include <cstdio>
#include <cstdlib>

using namespace efree;

namespace {

struct Errors3 {
  std::vector<double> displacement, stress, recovered;
};

template <int Dim> struct AnyBody {
  FineMesh<Dim> mesh;
  double spacing;
  std::vector<std::string> outer, inner;
};
template <int Dim> AnyBody<Dim> find_body(const std::string& name) {
  if constexpr (Dim == 2) {
    const auto body = testing::body(name);
    return {body.mesh, body.spacing, body.outer, body.inner};
  } else {
    const bool slit = name == "slit_box";
    return {testing::solid(name), 0.4, testing::box_sides,
            slit ? std::vector<std::string>{"slit"} : std::vector<std::string>{}};
  }
}

template <int Dim> void add_errors(const AnyBody<Dim>& body, const Approximation<Dim>& approximation,
                                   const ElasticModel& model, int degree, Errors3& errors) {
  std::vector<std::string> loaded(body.outer.begin() + 1, body.outer.end());
  loaded.insert(loaded.end(), body.inner.begin(), body.inner.end());
  const auto add = [&](const auto& field) {
    for (const bool all : {true, false}) {
      const auto error = all ? testing::patch_error(approximation, model, field, body.outer, body.inner)
                             : testing::patch_error(approximation, model, field, {body.outer[0]}, loaded);
      errors.displacement.push_back(error.displacement);
      errors.stress.push_back(error.stress);
      errors.recovered.push_back(error.recovered);
    }
  };
  if (degree == 1)
    for (const auto& field : testing::linear_fields<Dim>()) add(field);
  else
    for (const auto& field : testing::quadratic_fields<Dim>()) add(field);
}

void print_row(const std::string& name, const char* secondary, const char* essential, Errors3& errors) {
  std::printf("| %s | %s | %s |", name.c_str(), secondary, essential);
  for (auto* list : {&errors.displacement, &errors.stress, &errors.recovered}) {
    std::sort(list->begin(), list->end());
    std::printf(" %.1e | %.1e |", list->back(), (*list)[list->size() / 2]);
  }
  std::printf("\n");
  std::fflush(stdout);
}

template <int Dim> void print_table(int clouds, int degree, const std::vector<std::string>& names) {
  for (const auto& name : names) {
    const auto body = find_body<Dim>(name);
    for (const auto secondary : {SecondaryKind::cells, SecondaryKind::linear, SecondaryKind::mls})
      for (const auto essential : {Essential::nitsche, Essential::strong}) {
        Errors3 errors;
        for (int seed = 1; seed <= clouds; ++seed) {
          ApproximationOptions options{.order = degree,
                                       .interpolation = degree == 2 ? 2 : 0,
                                       .spacing = body.spacing,
                                       .seed = static_cast<std::uint64_t>(seed),
                                       .secondary = secondary};
          if (essential == Essential::strong) options.vanish_on = body.outer;
          add_errors(body, approximate(body.mesh, options),
                     {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress, .essential = essential}, degree,
                     errors);
        }
        print_row(name, testing::name_of(secondary), essential == Essential::nitsche ? "Nitsche" : "strong", errors);
      }
  }
}

}  // namespace

int main(int argc, char** argv) {
  const int clouds = argc > 1 ? std::atoi(argv[1]) : 20;
  const bool solids = argc > 2 && std::atoi(argv[2]) == 3;
  const int degree = argc > 3 ? std::atoi(argv[3]) : 1;
  std::printf(
      "| body | secondary basis | conditions | displacement, worst | median | stress, worst | median | recovered "
      "stress, worst | median |\n");
  std::printf("|---|---|---|---|---|---|---|---|---|\n");
  if (solids) return print_table<3>(clouds, degree, {"box", "flat_cells", "slit_box"}), 0;
  const std::vector<std::string> names{"square", "slivers", "plate_with_hole", "l_shape", "slit"};
  print_table<2>(clouds, degree, names);
  if (degree == 2) return 0;
  for (const auto& name : names) {
    const auto body = find_body<2>(name);
    Errors3 errors;
    for (int seed = 1; seed <= clouds; ++seed) {
      const ApproximationOptions options{.spacing = body.spacing, .seed = static_cast<std::uint64_t>(seed)};
      add_errors(body, testing::with_point_evaluation(body.mesh, options),
                 {.material = LinearElastic(1.0, 0.3), .plane = Plane::stress}, 1, errors);
    }
    print_row(name, "cells, gradients evaluated", "Nitsche", errors);
  }
}
