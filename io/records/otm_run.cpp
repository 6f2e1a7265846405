// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/otm_run.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/packer.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/pictures/picture.hpp"
#include "efree/io/records/internal/json_array.hpp"
#include "efree/io/records/internal/unfinished.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <tuple>

namespace efree {
namespace fs = std::filesystem;

namespace {

using internal::json_array, nlohmann::ordered_json;

constexpr std::string_view otm_state_kind = "efree otm 3\n";
constexpr const char* otm_state_name = "otm.state";

/// What probes say, by columns.
template <int Dim>
typename OtmRecord<Dim>::More columns(const MotionSettings<Dim>& motion, const MovingBodies<Dim>& bodies) {
  constexpr const char* axes[] = {"x", "y", "z"};
  typename OtmRecord<Dim>::More more;
  for (const auto& [name, values] : measure(motion, bodies)) {
    const std::string column = "probe." + name;
    if (values.size() == 1) {
      more.emplace_back(column, values[0]);
      continue;
    }
    for (int i = 0; i < Dim; ++i) more.emplace_back(fmt::format("{}.u{}", column, axes[i]), values[i]);
    for (int i = 0; i < Dim; ++i) more.emplace_back(fmt::format("{}.v{}", column, axes[i]), values[Dim + i]);
  }
  return more;
}

/// Whether energies, places, velocities and all fields are numbers.
template <int Dim> bool is_finite(const Otm<Dim>& otm) {
  const auto scalars = point_scalars(otm);
  return std::isfinite(otm.balance().total()) && otm.nodes().allFinite() && otm.velocities().allFinite() &&
         std::ranges::all_of(scalars, [](const auto& entry) { return entry.second.allFinite(); });
}

}  // namespace

template <int Dim> OtmRun<Dim>::OtmRun(fs::path directory, const OtmCase<Dim>& of, bool pictures)
    : directory_(std::move(directory)),
      case_(of),
      pictures_(pictures),
      unfinished_(std::make_unique<internal::Unfinished>(directory_)) {}
template <int Dim> OtmRun<Dim>::~OtmRun() = default;

template <int Dim> bool OtmRun<Dim>::is_unfinished() const {
  return fs::exists(unfinished_->folder() / otm_state_name);
}

template <int Dim> void OtmRun<Dim>::begin() {
  if (record_) return;
  unfinished_->begin();
  for (const auto& entry : fs::directory_iterator(unfinished_->folder())) fs::remove_all(entry.path());
  record_.emplace(unfinished_->folder());
}

template <int Dim> void OtmRun<Dim>::resume(MovingBodies<Dim>& bodies) {
  const bool killed = is_unfinished();
  const fs::path folder = killed ? unfinished_->folder() : directory_, file = folder / otm_state_name;
  if (!fs::exists(file))
    throw InputError(
        fmt::format("{}: there are no steps of an earlier run to resume: run without --resume", file.string()));
  const internal::Sealed sealed = internal::read_sealed(file, otm_state_kind, Dim, case_.mark);
  unfinished_->begin();
  std::string record;
  try {
    internal::Unpacker unpack(sealed.packed());
    unpack(record);
    bodies.otm.restore(unpack.rest());
    if (!is_finite(bodies.otm) || !std::isfinite(bodies.otm.energy().error())) internal::is_damaged(file);
  } catch (const InputError&) {
    internal::is_damaged(file);
  }
  if (const double now = bodies.otm.time(); now > case_.motion.end * (1.0 + 1e-12))
    throw InputError(internal::said_at(
        internal::where_said(case_, "time.end"),
        fmt::format("end is {:.6g}, and the steps of the earlier run are at {:.6g} already", case_.motion.end, now)));
  if (!killed)
    for (const auto& entry : fs::directory_iterator(directory_))
      if (const std::string name = entry.path().filename().string();
          OtmRecord<Dim>::is_ours(name) || name == otm_state_name)
        internal::link(entry.path(), unfinished_->folder() / name);
  record_.emplace(unfinished_->folder(), record);
}

template <int Dim> void OtmRun<Dim>::line(const MovingBodies<Dim>& bodies) {
  begin();
  record_->note(bodies.otm, columns(case_.motion, bodies));
}

template <int Dim> void OtmRun<Dim>::frame(const MovingBodies<Dim>& bodies) {
  begin();
  const Otm<Dim>& otm = bodies.otm;
  const std::string picture = fmt::format("frame_{:04}.png", record_->num_frames());
  record_->add_frame(otm);
  if (!pictures_) return;
  const auto scalars = point_scalars(otm);
  const auto find = [&](const std::string& name) {
    return std::ranges::find(scalars, name, [](const auto& entry) { return entry.first; });
  };
  auto field = find(case_.motion.colour.empty() ? "equivalent_plastic_strain" : case_.motion.colour);
  if (field == scalars.end()) field = find("von_mises");
  BoundingBox<Dim> view(bodies.start.rowwise().minCoeff(), bodies.start.rowwise().maxCoeff());
  for (Index a = 0; a < otm.num_nodes(); ++a) view.extend(Vec<Dim>(otm.nodes().col(a)));
  MotionPicture<Dim> drawn{.points = otm.points(),
                           .F = otm.deformation(),
                           // Points that came later are as large as the others are.
                           .size = bodies.size.size() == otm.num_points()
                                       ? bodies.size
                                       : Vector::Constant(otm.num_points(), bodies.size.mean()),
                           .values = field->second,
                           .title = fmt::format("{}, time {:.4g}", case_.title, otm.time()),
                           .field = field->first,
                           .view = view,
                           .axisymmetric = case_.model.plane == Plane::axisymmetric};
  for (const auto& [wall, where] : case_.motion.walls) drawn.walls.push_back(wall);
  const std::vector<ToolState<Dim>> states = otm.tools();
  for (std::size_t k = 0; k < states.size(); ++k)
    drawn.tools.emplace_back([&tool = case_.motion.tools[k].tool, state = states[k]](const Vec<Dim>& at) {
      return gap_to<Dim>(tool, state, at).gap;
    });
  draw_motion(unfinished_->folder() / picture, drawn);
}

template <int Dim> void OtmRun<Dim>::checkpoint(const MovingBodies<Dim>& bodies) {
  begin();
  std::string record = record_->state();
  internal::Packer pack;
  pack(record);
  internal::write_sealed(unfinished_->folder() / otm_state_name, otm_state_kind, Dim, case_.mark,
                         {std::move(pack).bytes(), bodies.otm.state()});
}

template <int Dim> void OtmRun<Dim>::finish(OutputDirectory& out) const {
  for (const auto& entry : fs::directory_iterator(directory_))
    if (const std::string name = entry.path().filename().string();
        OtmRecord<Dim>::is_ours(name) || name == otm_state_name)
      out.supersede(name);
  for (const auto& entry : fs::directory_iterator(unfinished_->folder()))
    if (const std::string name = entry.path().filename().string();
        OtmRecord<Dim>::is_ours(name) || name == otm_state_name)
      internal::link(entry.path(), out.file(name));
}

template <int Dim> void OtmRun<Dim>::forget() {
  unfinished_->forget();
}

namespace {

/// Times that a point took another's functions, or would in the next step.
template <int Dim> Index joined_so_far(const Otm<Dim>& otm) {
  return otm.counts().joined + otm.num_held();
}

}  // namespace

template <int Dim> std::vector<std::string> warnings_of(const OtmCase<Dim>& of, const MovingBodies<Dim>& bodies) {
  std::vector<std::string> warnings = bodies.warnings;
  const EnergyWatch energy = bodies.otm.energy();
  if (const double error = energy.largest_error(); std::abs(error) > warned_imbalance)
    warnings.push_back(
        fmt::format("the energy is off by up to {:.2g} %: smaller steps (otm.courant) or finer bodies "
                    "may help",
                    100.0 * error));
  if (const double taken = bodies.otm.balance().renewal; taken > warned_renewal * energy.scale)
    warnings.push_back(fmt::format(
        "changes of functions took {:.2g} % of the energy, as where parts of a body meet, which stick to each other, "
        "functions are renewed often, or shocks have no viscosity: otm.shock, a larger otm.renewal or more "
        "otm.stabilisation may help",
        100.0 * taken / energy.scale));
  if (const Index joined = joined_so_far(bodies.otm); joined > 0)
    warnings.push_back(
        fmt::format("{} times of {} material points one had no functions of its own, or would have been turned inside "
                    "out, and took those of the next: finer bodies may help",
                    joined, bodies.otm.num_points()));
  if (const Index passed = bodies.otm.counts().passed; passed > 0)
    warnings.push_back(fmt::format(
        "{} of {} material points got through the surface of another body: viscosity of shocks (otm.shock), "
        "stiffer springs (contact.stiffness) or finer bodies may help",
        passed, bodies.otm.num_points()));
  for (const auto& [name, values] : measure(of.motion, bodies))
    if (std::isnan(values[0])) warnings.push_back(fmt::format("probe \"{}\": nothing is in its box at the end", name));
  return warnings;
}

template <int Dim> void write_otm_result(const fs::path& file, const OtmCase<Dim>& of, const MovingBodies<Dim>& bodies,
                                         const MotionEnd& end, const std::vector<std::string>& warnings,
                                         const StageTimes& times) {
  const Otm<Dim>& otm = bodies.otm;
  const OtmBalance<Dim> now = otm.balance();
  const EnergyWatch energy = otm.energy();
  const OtmCounts& counts = otm.counts();
  const OtmTimes spent = otm.times();
  ordered_json json;
  json["title"] = of.title;
  json["kind"] = "otm";
  json["dimension"] = Dim;
  json["bodies"] = bodies.names;
  json["time"] = otm.time();
  if (!end.refusal.empty()) json["stopped"] = end.refusal;
  json["counts"] = {{"nodes", otm.num_nodes()},    {"material_points", otm.num_points()},
                    {"steps", counts.steps},       {"updates", counts.updates},
                    {"renewals", counts.renewals}, {"iterations", counts.iterations},
                    {"widened", counts.widened},   {"kept", counts.kept},
                    {"merged", counts.merged},     {"injected", counts.injected},
                    {"fused", counts.fused},       {"joined", joined_so_far(otm)},
                    {"eroded", counts.eroded},     {"passed", counts.passed}};
  json["stable_step"] = otm.stable_step();
  json["energy"] = {{"start", energy.start},          {"kinetic", now.kinetic},
                    {"stored", now.stored},           {"dissipated", now.dissipated},
                    {"stabilising", now.stabilising}, {"viscous", now.viscous},
                    {"contact", now.contact},         {"renewal", now.renewal},
                    {"prescribed", now.prescribed},   {"weight", now.weight},
                    {"fracture", now.fracture},       {"total", now.total()},
                    {"error", energy.error()},        {"largest_error", energy.largest_error()}};
  json["momentum"] = json_array(now.momentum);
  json["moment_of_momentum"] = json_array(now.moment);
  for (const ToolState<Dim>& tool : otm.tools())
    json["tools"].push_back({{"centre", json_array(tool.centre)},
                             {"velocity", json_array(tool.velocity)},
                             {"spin", json_array(tool.spin)},
                             {"force", json_array(tool.force)},
                             {"impulse", json_array(tool.impulse)},
                             {"work", tool.work}});
  for (Index w = 0; w < otm.wall_forces().cols(); ++w)
    json["walls"].push_back({{"force", json_array(otm.wall_forces().col(w))}});
  json["probes"] = ordered_json::object();
  for (const auto& [name, values] : measure(of.motion, bodies)) {
    if (values.size() > 1)
      json["probes"][name] = {{"displacement", std::vector<double>(values.begin(), values.begin() + Dim)},
                              {"velocity", std::vector<double>(values.begin() + Dim, values.end())}};
    else if (!std::isnan(values[0]))
      json["probes"][name] = values[0];
  }
  const Points<Dim> points = otm.points();
  for (const auto& [name, values] : point_scalars(otm)) {
    Index most = 0, least = 0;
    values.maxCoeff(&most);
    values.minCoeff(&least);
    json["extremes"][name] = {{"max", {{"value", values[most]}, {"at", json_array(points.col(most))}}},
                              {"min", {{"value", values[least]}, {"at", json_array(points.col(least))}}}};
  }
  json["reports"]["warnings"] = warnings;
  const double all = spent.functions + spent.kinematics + spent.materials + spent.forces + spent.stability +
                     spent.nodes + spent.contact + spent.fracture;
  if (all > 0.0)
    json["shares"] = {{"functions", spent.functions / all}, {"kinematics", spent.kinematics / all},
                      {"materials", spent.materials / all}, {"forces", spent.forces / all},
                      {"stability", spent.stability / all}, {"nodes", spent.nodes / all},
                      {"contact", spent.contact / all},     {"fracture", spent.fracture / all}};
  for (const auto& [stage, seconds] : times.stages()) json["seconds"][stage] = seconds;
  json["seconds"]["total"] = times.total();
  json["peak_memory_mb"] = peak_memory_mb();
  json["threads"] = num_threads();
  json["version"] = version();
  std::ofstream stream(file);
  stream << json.dump(2, ' ', false, ordered_json::error_handler_t::replace) << '\n';
  if (!stream.flush()) internal::cannot_write(file);
}

template class OtmRun<2>;
template class OtmRun<3>;
template std::vector<std::string> warnings_of(const OtmCase<2>&, const MovingBodies<2>&);
template std::vector<std::string> warnings_of(const OtmCase<3>&, const MovingBodies<3>&);
template void write_otm_result(const fs::path&, const OtmCase<2>&, const MovingBodies<2>&, const MotionEnd&,
                               const std::vector<std::string>&, const StageTimes&);
template void write_otm_result(const fs::path&, const OtmCase<3>&, const MovingBodies<3>&, const MotionEnd&,
                               const std::vector<std::string>&, const StageTimes&);

}  // namespace efree
