// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/otm_record.hpp"

#include "efree/analysis/motion.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/internal/packer.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/internal/series.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <fstream>
#include <regex>

namespace efree {
namespace fs = std::filesystem;
namespace {

constexpr const char* history_name = "history.csv";
constexpr const char* axis_names[] = {"x", "y", "z"};

std::string frame(const char* of, std::size_t number) {
  return fmt::format("{}_{:04}.vtu", of, number);
}

}  // namespace

template <int Dim> bool OtmRecord<Dim>::is_ours(const std::string& name) {
  static const std::regex ours(R"((points|nodes)(_[0-9]{4,9}\.vtu|\.pvd)|frame_[0-9]{4,9}\.png|history\.csv)");
  return std::regex_match(name, ours);
}

template <int Dim> OtmRecord<Dim>::OtmRecord(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (!fs::is_directory(folder_, error)) internal::cannot_write(folder_);
  for (const auto& entry : fs::directory_iterator(folder_, error))
    if (is_ours(entry.path().filename().string())) fs::remove(entry.path(), error);
}

template <int Dim> OtmRecord<Dim>::OtmRecord(fs::path folder, std::string_view state) : folder_(std::move(folder)) {
  internal::Unpacker unpack(state);
  unpack(points_), unpack(nodes_), unpack(history_);
  if (!unpack.empty() || nodes_.size() != points_.size()) throw InputError("expected the state of a record");
  const Index frames = num_frames();
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    const auto digits = name.find('_');
    if (is_ours(name) && digits != std::string::npos && std::stol(name.substr(digits + 1)) >= frames)
      fs::remove(entry.path(), error);
  }
  // Not in place: they may be links to results.
  for (const char* name : {history_name, "points.pvd", "nodes.pvd"}) fs::remove(folder_ / name, error);
  write_series();
  std::ofstream out(folder_ / history_name);
  out << history_;
  if (!out.flush()) internal::cannot_write(folder_ / history_name);
}

template <int Dim> std::string OtmRecord<Dim>::state() const {
  internal::Packer pack;
  Frames points = points_, nodes = nodes_;
  std::string history = history_;
  pack(points), pack(nodes), pack(history);
  return std::move(pack).bytes();
}

template <int Dim> void OtmRecord<Dim>::add(const Otm<Dim>& otm, const More& more) {
  add_frame(otm);
  note(otm, more);
}

template <int Dim> void OtmRecord<Dim>::add_frame(const Otm<Dim>& otm) {
  const Tensors sigma = otm.cauchy_stress();
  const Index n = otm.num_points();
  Matrix stress(6, n), of_point(1, n), of_node(1, otm.num_nodes());
  for (Index p = 0; p < n; ++p) stress.col(p) = stress_of<3>(sigma.col(p));
  for (Index b = 0; b < otm.num_bodies(); ++b) {
    of_point.middleCols(otm.first_point(b), otm.first_point(b + 1) - otm.first_point(b)).setConstant(b);
    of_node.middleCols(otm.first_node(b), otm.first_node(b + 1) - otm.first_node(b)).setConstant(b);
  }
  std::vector<PointValues> values{{"stress", stress, {"xx", "yy", "zz", "yz", "xz", "xy"}}, {"body", of_point}};
  for (const auto& [name, scalar] : point_scalars(otm)) values.push_back({name, scalar.transpose()});
  const std::vector<std::string> components(axis_names, axis_names + Dim);
  points_.emplace_back(otm.time(), frame("points", points_.size()));
  nodes_.emplace_back(otm.time(), frame("nodes", nodes_.size()));
  write_points<Dim>(folder_ / points_.back().second, otm.points(), values);
  write_points<Dim>(
      folder_ / nodes_.back().second, otm.nodes(),
      {{"velocity", otm.velocities(), components}, {"mass", otm.masses().transpose()}, {"body", of_node}});
  write_series();
}

template <int Dim> void OtmRecord<Dim>::write_series() const {
  internal::write_series(folder_ / "points.pvd", points_);
  internal::write_series(folder_ / "nodes.pvd", nodes_);
}

template <int Dim> void OtmRecord<Dim>::note(const Otm<Dim>& otm, const More& more) {
  const OtmBalance<Dim> now = otm.balance();
  const OtmCounts& counts = otm.counts();
  More line{{"t", otm.time()},
            {"steps", counts.steps},
            {"dt", otm.stable_step()},
            {"kinetic", now.kinetic},
            {"stored", now.stored},
            {"dissipated", now.dissipated},
            {"stabilising", now.stabilising},
            {"viscous", now.viscous},
            {"contact", now.contact},
            {"renewal", now.renewal},
            {"fracture", now.fracture},
            {"prescribed", now.prescribed},
            {"weight", now.weight},
            {"total", now.total()},
            {"nodes", otm.num_nodes()},
            {"points", otm.num_points()},
            {"renewals", static_cast<double>(counts.renewals)},
            {"widened", static_cast<double>(counts.widened)},
            {"kept", static_cast<double>(counts.kept)},
            {"merged", counts.merged},
            {"injected", counts.injected},
            {"eroded", counts.eroded}};
  for (int i = 0; i < Dim; ++i) line.emplace_back(fmt::format("momentum.{}", axis_names[i]), now.momentum[i]);
  for (int i = 0; i < now.moment.size(); ++i)
    line.emplace_back(fmt::format("moment.{}", axis_names[Dim == 2 ? 2 : i]), now.moment[i]);
  const Points<Dim>& walls = otm.wall_forces();
  for (Index w = 0; w < walls.cols(); ++w)
    for (int i = 0; i < Dim; ++i) line.emplace_back(fmt::format("wall.{}.{}", w, axis_names[i]), walls(i, w));
  const std::vector<ToolState<Dim>> tools = otm.tools();
  for (std::size_t k = 0; k < tools.size(); ++k) {
    const auto add = [&](const char* name, const auto& values) {
      for (int i = 0; i < values.size(); ++i)
        line.emplace_back(fmt::format("tool.{}.{}.{}", k, name, axis_names[values.size() == 1 ? 2 : i]), values[i]);
    };
    add("centre", tools[k].centre);
    add("velocity", tools[k].velocity);
    add("spin", tools[k].spin);
    add("force", tools[k].force);
    add("impulse", tools[k].impulse);
    line.emplace_back(fmt::format("tool.{}.work", k), tools[k].work);
  }
  line.insert(line.end(), more.begin(), more.end());
  std::string added;
  if (history_.empty()) {
    for (const auto& [name, value] : line) added += fmt::format("{}{}", added.empty() ? "" : ",", name);
    added += '\n';
  }
  for (std::size_t k = 0; k < line.size(); ++k) added += fmt::format("{}{}", k == 0 ? "" : ",", line[k].second);
  added += '\n';
  std::ofstream out(folder_ / history_name, history_.empty() ? std::ios::trunc : std::ios::app);
  out << added;
  if (!out.flush()) internal::cannot_write(folder_ / history_name);
  history_ += added;
}

template class OtmRecord<2>;
template class OtmRecord<3>;

}  // namespace efree
