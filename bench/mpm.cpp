// SPDX-License-Identifier: GPL-3.0-or-later
// bench_mpm NAME ...: rows of the material point method, one or several of transfers, energy, noise, crossing, vortex,
// contact, strip, taylor, speed, rankine, cook, cracks; `all` is all of these. `scenes` are those of slides.hpp, with a
// quarter of their points or (--full) all, also by their names. Each prints what it measures beside its
// bar, and the exit status is 1 where one is missed.

#include "efree/core/error.hpp"
#include "efree/dynamics/schemes/mpm/internal/spline.hpp"

#include "clock.hpp"
#include "crack_scenes.hpp"
#include "mpm_scenes.hpp"
#include "rows.hpp"
#include "slides.hpp"

#include <cstdio>
#include <functional>
#include <string>

namespace efree {
namespace {

using namespace bench;

constexpr std::pair<Transfer, const char*> transfers_by_name[] = {
    {Transfer::pic, "PIC"},     {Transfer::flip, "FLIP"},       {Transfer::apic, "APIC"},   {Transfer::rpic, "RPIC"},
    {Transfer::aflip, "AFLIP"}, {Transfer::polypic, "PolyPIC"}, {Transfer::xpic, "XPIC(2)"}};

constexpr std::pair<MpmFrame, const char*> frames_by_name[] = {
    {MpmFrame::updated, "updated"}, {MpmFrame::total, "total"}, {MpmFrame::mesh, "mesh"}};

template <int Dim, int Degree> double largest_spline_error() {
  double worst = 0.0;
  for (int k = 0; k < 1000; ++k) {
    // Positions all over a cell, its edges among them.
    const double position = 7.0 + 1e-3 * k;
    internal::SplineRow<Degree> row;
    internal::evaluate_spline<Degree>(position, row);
    double sum = -1.0, first = -position, slope = 0.0, linear = -1.0;
    for (int i = 0; i <= Degree; ++i) {
      const double at = static_cast<double>(row.first) + i;
      sum += row.N[i];
      first += row.N[i] * at;
      slope += row.dN[i];
      linear += row.dN[i] * at;
    }
    for (const double error : {sum, first, slope, linear}) worst = std::max(worst, std::abs(error));
  }
  return worst;
}

bool transfers() {
  bool good = true;
  const double splines =
      std::max({largest_spline_error<2, 1>(), largest_spline_error<2, 2>(), largest_spline_error<2, 3>()});
  good &= row("transfers", "splines: sum, first moment, gradients", splines, 0.0, 1e-13);
  const auto lost = [&]<int Dim>(Index steps) {
    for (const auto& [transfer, name] : transfers_by_name) {
      const auto [linear, angular] = lost_momenta<Dim>({.cell = 0.25, .transfer = transfer}, steps);
      const std::string in =
          std::string(name) + (Dim == 2 ? " in the plane, " : " in space, ") + std::to_string(steps) + " steps: ";
      good &= row("transfers", in + "momentum", linear, 0.0, 1e-13);
      if (transfer == Transfer::apic || transfer == Transfer::rpic || transfer == Transfer::polypic)
        good &= row("transfers", in + "angular momentum", angular, 0.0, 1e-12);
    }
  };
  lost.template operator()<2>(100000);
  lost.template operator()<3>(100000);
  return good;
}

bool energy() {
  bool good = true;
  std::vector<double> errors, losses;
  for (const Index n : {16, 32, 64}) {
    const Vibration bar = vibrate({.cell = 1.0 / n, .transfer = Transfer::apic});
    errors.push_back(std::abs(bar.frequency_error));
    losses.push_back(bar.lost);
    std::printf("energy     APIC, %d cells: frequency off by %.3g, energy lost in 4 periods %.3g, largest gain %.2g\n",
                n, bar.frequency_error, bar.lost, bar.gained);
    good &= row("energy", "largest gain of energy", bar.gained, 0.0, 1e-3);
  }
  good &= row("energy", "order of the frequency", std::log2(errors[1] / errors[2]), 1.8, 3.0);
  good &= row("energy", "order of APIC's loss", std::log2(losses[1] / losses[2]), 0.8, 4.0);
  return good;
}

bool noise() {
  bool good = true;
  for (const auto& [transfer, name] : transfers_by_name) {
    const double left = noise_left(transfer);
    const bool keeps = transfer == Transfer::flip || transfer == Transfer::aflip;
    good &= keeps ? row("noise", std::string(name) + ": velocity without an image that is left", left, 0.9, 1.0)
                  : row("noise", std::string(name) + ": velocity without an image that is left", left, 0.0, 1e-12);
  }
  return good;
}

bool crossing() {
  bool good = true;
  for (const int degree : {1, 2, 3}) {
    const MpmOptions options{.cell = 1.0 / 32, .degree = degree, .transfer = Transfer::flip, .flip = 1.0};
    const Vibration rest = vibrate(options, 0.0), drifts = vibrate(options, 100.0);
    const double frequency = std::abs(drifts.frequency_error - rest.frequency_error);
    const double stress = std::abs(drifts.stress / rest.stress - 1.0);
    const std::string of = "degree " + std::to_string(degree) + ", 100 cells: ";
    if (degree == 1) {
      good &= row("crossing", of + "stress over that at rest, less one (fails)", stress, 0.01, 1e9);
    } else {
      good &= row("crossing", of + "frequency over that at rest, less one", frequency, 0.0, 0.01);
      good &= row("crossing", of + "stress over that at rest, less one", stress, 0.0, 0.01);
    }
  }
  return good;
}

/// `updated` with eight points along a cell: at shears of 6 fewer lose each other.
bool vortex() {
  bool good = true;
  for (const auto& [frame, name] : frames_by_name) {
    const bool updated = frame == MpmFrame::updated;
    std::vector<double> errors;
    const auto cells = updated ? std::array<Index, 2>{4, 8} : std::array<Index, 2>{8, 16};
    for (const Index n : cells) {
      errors.push_back(vortex_error({.cell = 0.5 / n}, frame, 1.0, updated ? 8 : 2));
      std::printf("vortex     %s, %d cells across: positions off by %.3g\n", name, n, errors.back());
      std::fflush(stdout);
    }
    if (!updated)
      good &= row("vortex", name + std::string(": order"), std::log2(errors[0] / errors[1]), 1.8, 4.0);
    else
      good &= row("vortex", "updated: error over that of cells twice as wide", errors[1] / errors[0], 0.0, 0.9);
  }
  return good;
}

bool strip() {
  bool good = true;
  for (const auto& [frame, name] : frames_by_name) {
    if (frame == MpmFrame::updated) continue;
    const StretchedStrip strip = stretch_strip({.cell = 2.0}, frame, 2.0);
    good &= row("strip", name + std::string(": scatter of stresses at a stretch of 1.3"), strip.scatter, 0.0, 0.05);
    good &= row("strip", name + std::string(": stretch at a gap (0: none)"), strip.gap_at, 0.0, 0.0);
  }
  for (const int degree : {2, 3})
    for (const Index points : {2, 3, 4}) {
      const StretchedStrip updated = stretch_strip({.cell = 2.0, .degree = degree}, MpmFrame::updated, 3.5, points);
      std::printf(
          "strip      updated, degree %d, %d points along: scatter at 1.3 %.3g, separated at %.3g, gap at %.3g\n",
          degree, points, updated.scatter, updated.reported_at, updated.gap_at);
      good &= row("strip", "updated: stretch at the first report over that at a gap (if any to 3.5)",
                  updated.reported_at / (updated.gap_at == 0.0 ? 3.5 : updated.gap_at), 0.1, 0.95);
    }
  return good;
}

bool taylor() {
  bool good = true;
  const double size = 0.443e-3;
  std::vector<TaylorBar::Shape> shapes;
  for (const auto& [frame, name] : frames_by_name) {
    const TaylorRun run = run_taylor({.cell = 2.0 * size}, frame, 80e-6);
    shapes.push_back(run.shape);
    std::printf("taylor     %s: %d points, %d steps, energy off by %.2g %%, %.3g CPU s\n", name, run.points, run.steps,
                100.0 * run.energy_error, run.seconds);
    const std::string of = name + std::string(": ");
    good &= row("taylor", of + "length [mm]", 1e3 * run.shape.length, 21.4, 21.7);
    good &= row("taylor", of + "foot [mm]", 1e3 * run.shape.foot, 6.9, 7.3);
    good &= row("taylor", of + "plastic strain", run.shape.plastic_strain, 2.5, 3.3);
  }
  for (const std::size_t k : {1, 2})
    good &= row("taylor", frames_by_name[k].second + std::string(": length over that of `updated`"),
                shapes[k].length / shapes[0].length, 0.97, 1.03);
  return good;
}

bool cook() {
  bool good = true;
  for (const auto& [frame, name] : frames_by_name) {
    const std::string of = name + std::string(": ");
    good &= row("cook", of + "deflection at nu = 0.3 (9.1218)", cook_deflection(2.0, 0.3, frame, false), 8.85, 9.4);
    good &= row("cook", of + "at nu = 0.4999 (7.695)", cook_deflection(2.0, 0.4999, frame), 7.46, 7.93);
  }
  std::printf("cook       total, without pressure patches: %.4f\n",
              cook_deflection(2.0, 0.4999, MpmFrame::total, false));
  return good;
}

/// One point whose strain grows along an axis alone: closed form with linear softening. And a strip that tears, with
/// the softening modulus of a band two cells wide, on grids that are not aligned with the notch.
bool rankine() {
  constexpr double strength = 0.01, softening = 0.3, E = 1.0, nu = 0.2;
  const Rankine material({.moduli = {.E = E, .nu = nu}, .strength = strength, .softening = softening});
  const double lambda = E * nu / (1.0 + nu) / (1.0 - 2.0 * nu), stiff = lambda + E / (1.0 + nu);
  Deformation point = Deformation::none(Points<3>::Zero(3, 1), material.history_size());
  double worst = 0.0;
  for (int k = 1; k <= 50; ++k) {
    const double strain = 1e-3 * k, stretch = std::exp(strain);
    point.F.col(0)[0] = stretch;
    const MaterialResponse response = respond(material, point, false);
    const double opening = std::max(0.0, (stiff * strain - strength) / (stiff - softening));
    const double elastic = softening * opening > strength ? 0.0 : strain - opening;
    worst = std::max(
        {worst, std::abs(response.P(0, 0) * stretch - stiff * elastic), std::abs(response.P(4, 0) - lambda * elastic)});
    point.history = response.history;
  }
  bool good = row("rankine", "a point: stresses over the strength less closed form", worst / strength, 0.0, 1e-10);
  const double fracture_energy = 1e-4, coarse = softening_modulus(strength, fracture_energy, 2.0 / 32);
  for (const double cells : {32.0, 48.0, 64.0}) {
    const double cell = 1.0 / cells;
    MpmOptions options{.cell = cell};
    options.origin = {0.25 * cell, 0.25 * cell, 0.0};
    const double energy =
        torn_strip_dissipation(options, softening_modulus(strength, fracture_energy, 2.0 * cell)) / fracture_energy;
    good &= row("rankine", "notched strip, " + std::to_string(static_cast<int>(cells)) + " cells: energy over G_c",
                energy, 0.9, 1.1);
    if (cells == 32.0) continue;
    const double bare = torn_strip_dissipation(options, coarse) / fracture_energy;
    std::printf("rankine    with the softening modulus of 32 cells: %.3f\n", bare);
    if (cells == 64.0) good &= row("rankine", "the same: drifts", bare, 0.0, 0.85);
  }
  return good;
}

bool speed() {
  bool good = true;
  for (const bool total : {false, true}) {
    const int before = num_threads();
    set_num_threads(1);
    const TaylorRun run = run_taylor({.cell = 2.0 * 0.443e-3}, total ? MpmFrame::total : MpmFrame::updated, 20e-6);
    set_num_threads(before);
    const double updates = 1e-6 * static_cast<double>(run.points) * static_cast<double>(run.steps) / run.seconds;
    good &= row("speed", std::string(total ? "total" : "updated") + ", Taylor's bar to 20 us: million updates a second",
                updates, total ? 3.0 : 2.0, 1e3);
  }
  return good;
}

bool contact() {
  const double travel = sliding_travel(24.0, std::tan(15.0 * std::numbers::pi / 180.0), {.cell = 0.125});
  bool good = row("contact", "block on a slope of 24 degrees, friction tan 15: travel", travel, 0.99, 1.01);
  const Bounce bounce = bounce_discs({.cell = 0.05});
  good &= row("contact", "discs: gap at the first force, over the cell", bounce.gap_at_first_force, -0.5, 0.5);
  good &= row("contact", "discs: force once they are apart again", bounce.force_after, 0.0, 1e-12);
  good &= row("contact", "discs: momentum", bounce.momentum_error, 0.0, 1e-13);
  std::printf("contact    discs: restitution %.4f\n", bounce.restitution);
  return good;
}

template <int Dim> bool cracks_in(Index along) {
  bool good = true;
  const std::string in = Dim == 2 ? "in the plane, " : "in space, ";
  const FineMesh<Dim> body = block<Dim>(1.0, 0.5);
  const Points<Dim> points = points_in_unit_box<Dim>(along, 0.2);
  const PointMesh<Dim> mesh = mesh_between<Dim>(points, body);
  CrackedBody<Dim> torn(mesh, {.stretch = 1.5});
  good &= row("cracks", in + "uncut: cells that are not those of the fine mesh",
              static_cast<double>((torn.mesh().cells.array() != mesh.cells.array()).count()), 0.0, 0.0);
  // In disorder, more and more.
  CrackFaults worst;
  Index before = 0, lost = 0;
  for (const double amplitude : {0.4, 0.7, 1.5}) {
    const Points<Dim> moved = in_disorder<Dim>(points, amplitude / static_cast<double>(along));
    torn.move(moved);
    lost += torn.num_cut_edges() < before;
    before = torn.num_cut_edges();
    const CrackFaults faults = find_faults<Dim>(torn.mesh(), 1.0);
    worst.tiling = std::max(worst.tiling, faults.tiling);
    worst.open_edges += faults.open_edges + faults.inner_facets + faults.inverted;
    worst.wrong_parts += faults.wrong_parts;
  }
  torn.move(points);
  lost += torn.num_cut_edges() != before;
  std::printf("cracks     %s%d of %d edges cut in the end\n", in.c_str(), torn.num_cut_edges(), torn.num_edges());
  good &= row("cracks", in + "error of the volume of all pieces, over it", worst.tiling, 0.0, 1e-12);
  good &= row("cracks", in + "sides of the surface that are open, cells inside out", worst.open_edges, 0.0, 0.0);
  good &= row("cracks", in + "parts that are not those of uncut edges", worst.wrong_parts, 0.0, 0.0);
  good &= row("cracks", in + "times that a cut was undone", lost, 0.0, 0.0);
  for (const double slope : {0.0, 0.15, 0.4}) {
    CrackedBody<Dim> halves(mesh);
    Vec<Dim> normal = Vec<Dim>::Constant(slope);
    normal[0] = 1.0;
    halves.move(torn_by_plane<Dim>(points, normal.normalized(), (0.5 + 0.5 * slope * (Dim - 1)) / normal.norm(), 5.0));
    good &= row("cracks", in + "area of a plane crack over its section, slope " + std::to_string(slope).substr(0, 4),
                halves.mesh().crack_area / section_of_unit_box<Dim>(slope), 0.95, 1.05);
  }
  return good;
}
bool cracks() {
  return cracks_in<2>(60) & cracks_in<3>(16);
}

bool scene(const Slide& slide, bool full) {
  const std::string name = slide.name;
  const SlideRun run = run_slide(EFREE_SCENES "/slides", slide, full, "out/slides/" + name);
  std::printf(
      "scenes     %s: %d points, %d steps, %.3g s a frame; all frames meshed and drawn in %.3g s; %d parts, cracks of "
      "%.3g in the end\n",
      name.c_str(), run.points, run.steps, run.seconds / static_cast<double>(std::max(1, run.frames - 1)),
      run.crack_seconds, run.parts, run.crack_area);
  if (!run.failure.empty()) std::printf("scenes     %s: %s\n", name.c_str(), run.failure.c_str());
  bool good = row("scenes", name + ": ended before its time", run.failure.empty() ? 0.0 : 1.0, 0.0, 0.0);
  good &= row("scenes", name + ": seconds of the run", run.seconds, 0.0, 600.0);
  good &= row("scenes", name + ": smallest J", run.smallest_J, 1e-9, 10.0);
  good &= row("scenes", name + ": error of the energy", run.energy_error, 0.0, 0.02);
  good &= row("scenes", name + ": seconds to mesh a frame", run.mesh_seconds, 0.0, slide.mesh_seconds);
  return good;
}

}  // namespace
}  // namespace efree

int main(int argc, char** argv) {
  using Row = bool (*)();
  const std::pair<const char*, Row> rows[] = {
      {"transfers", efree::transfers}, {"energy", efree::energy}, {"noise", efree::noise},
      {"crossing", efree::crossing},   {"vortex", efree::vortex}, {"contact", efree::contact},
      {"strip", efree::strip},         {"taylor", efree::taylor}, {"speed", efree::speed},
      {"rankine", efree::rankine},     {"cook", efree::cook},     {"cracks", efree::cracks},
  };
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  const bool full = std::ranges::find(arguments, "--full") != arguments.end();
  bool good = true, known = !arguments.empty();
  for (const std::string& argument : arguments) {
    bool found = argument == "--full";
    for (const auto& [name, run] : rows)
      if (argument == name || argument == "all") {
        found = true;
        good &= run();
      }
    for (const auto& slide : efree::bench::slides)
      if (argument == "scenes" || argument == slide.name) {
        found = true;
        good &= efree::scene(slide, full);
      }
    known &= found;
  }
  if (!known) {
    std::puts(
        "bench_mpm transfers|energy|noise|crossing|vortex|contact|strip|taylor|speed|rankine|cook|cracks|all ...\n"
        "bench_mpm scenes [--full], or one of torn_strip, sheared_bar, twisted_bar, pulled_block, pierced_sheet, "
        "torn_shell, crushed_heap: into out/slides");
    return 2;
  }
  return good ? 0 : 1;
}
