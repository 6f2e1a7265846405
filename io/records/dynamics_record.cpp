// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/dynamics_record.hpp"

#include "efree/analysis/dynamics.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/packer.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/records/internal/csv.hpp"
#include "efree/io/records/internal/series.hpp"
#include "efree/io/records/internal/snake_case.hpp"
#include "efree/io/records/internal/vector_columns.hpp"
#include "efree/io/records/writers.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <fstream>
#include <iterator>
#include <regex>

namespace efree {
namespace fs = std::filesystem;
namespace {

using Numbers = std::vector<std::pair<std::string, double>>;

constexpr const char* history_name = "history.csv";
constexpr const char* axis_names[] = {"x", "y", "z"};

std::string frame_name(const char* kind, std::size_t number) {
  return fmt::format("{}_{:04}.vtu", kind, number);
}

using internal::add_vector;

template <int Dim> Numbers history_numbers(const Dynamics<Dim>& dynamics) {
  const auto balance = dynamics.balance();
  const Ledger ledger = dynamics.ledger();
  Numbers line{{"t", dynamics.time()}, {"steps", dynamics.steps()}, {"dt", dynamics.stable_step()}};
  for (const auto& energy : balance.energies.energies())
    line.emplace_back(internal::snake_case(energy.name), energy.value);
  line.emplace_back("total", balance.total());
  line.emplace_back("nodes", dynamics.num_nodes());
  line.emplace_back("points", dynamics.num_points());
  for (const auto& count : ledger.counts())
    line.emplace_back(internal::snake_case(count.name), static_cast<double>(count.value));
  add_vector("momentum", balance.momentum, line);
  add_vector("angular_momentum", balance.angular_momentum, line);
  const Points<Dim> walls = dynamics.wall_forces();
  for (Index w = 0; w < walls.cols(); ++w) add_vector(fmt::format("wall.{}", w), walls.col(w), line);
  Index number = 0;
  for (const RigidState<Dim>& body : dynamics.rigid_bodies()) {
    const std::string name = fmt::format("rigid_body.{}", number++);
    add_vector(name + ".centre", body.centre, line);
    add_vector(name + ".velocity", body.velocity, line);
    add_vector(name + ".spin", body.spin, line);
    add_vector(name + ".force", body.force, line);
    add_vector(name + ".impulse", body.impulse, line);
    line.emplace_back(name + ".work", body.work);
  }
  return line;
}

}  // namespace

template <int Dim> bool DynamicsRecord<Dim>::is_part(const std::string& name) {
  static const std::regex parts(
      R"((points|nodes)(_[0-9]{4,9}\.vtu|\.pvd)|bodies\.vtu|frame_([-A-Za-z0-9_]+_)?[0-9]{4,9}\.png|animation(_[-A-Za-z0-9_]+)?\.(webm|mp4|gif)|history\.csv)");
  return std::regex_match(name, parts);
}

template <int Dim> DynamicsRecord<Dim>::DynamicsRecord(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (!fs::is_directory(folder_, error)) internal::cannot_write(folder_);
  for (const auto& entry : fs::directory_iterator(folder_, error))
    if (is_part(entry.path().filename().string())) fs::remove(entry.path(), error);
}

template <int Dim> DynamicsRecord<Dim>::DynamicsRecord(fs::path folder, std::string_view state)
    : folder_(std::move(folder)) {
  Unpacker unpack(state);
  unpack(points_), unpack(nodes_), unpack(columns_), unpack(lines_);
  if (!unpack.empty() || nodes_.size() != points_.size()) throw InputError("expected the state of a record");
  const Index frames = num_frames();
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    static const std::regex numbered(".*_([0-9]+)[.](vtu|png)");
    std::smatch match;
    // Animations are made again at the end.
    if (is_part(name) &&
        (name.starts_with("animation") || (std::regex_match(name, match, numbered) && std::stol(match[1]) >= frames)))
      fs::remove(entry.path(), error);
  }
  // Not in place: they may be links to results.
  for (const char* name : {history_name, "points.pvd", "nodes.pvd"}) fs::remove(folder_ / name, error);
  write_series();
  write_history();
}

template <int Dim> std::string DynamicsRecord<Dim>::state() const {
  Packer pack;
  Frames points = points_, nodes = nodes_;
  std::vector<std::string> columns = columns_;
  std::string lines = lines_;
  pack(points), pack(nodes), pack(columns), pack(lines);
  return std::move(pack).bytes();
}

template <int Dim> void DynamicsRecord<Dim>::add_bodies(const FineMesh<Dim>& mesh) {
  write_mesh(folder_ / "bodies.vtu", mesh);
}

template <int Dim> void DynamicsRecord<Dim>::add(const Dynamics<Dim>& dynamics, const Numbers& more) {
  add_frame(dynamics);
  add_line(dynamics, more);
}

template <int Dim> void DynamicsRecord<Dim>::add_frame(const Dynamics<Dim>& dynamics) {
  const Tensors sigma = dynamics.cauchy_stress();
  const Index n = dynamics.num_points();
  Matrix stress(6, n), body_of_point(1, n), body_of_node(1, dynamics.num_nodes());
  for (Index p = 0; p < n; ++p) stress.col(p) = stress_of<3>(sigma.col(p));
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    const Index first_point = dynamics.first_point(b), first_node = dynamics.first_node(b);
    body_of_point.middleCols(first_point, dynamics.first_point(b + 1) - first_point).setConstant(b);
    body_of_node.middleCols(first_node, dynamics.first_node(b + 1) - first_node).setConstant(b);
  }
  std::vector<PointValues> values{{"stress", stress, {"xx", "yy", "zz", "yz", "xz", "xy"}}, {"body", body_of_point}};
  if (!dynamics.nodes_persist())
    values.push_back({"velocity", dynamics.point_velocities(), std::vector<std::string>(axis_names, axis_names + Dim)});
  for (const auto& [name, scalar] : point_scalars(dynamics)) values.push_back({name, scalar.transpose()});
  const std::vector<std::string> components(axis_names, axis_names + Dim);
  points_.emplace_back(dynamics.time(), frame_name("points", points_.size()));
  nodes_.emplace_back(dynamics.time(), frame_name("nodes", nodes_.size()));
  write_points<Dim>(folder_ / points_.back().second, dynamics.points(), values);
  write_points<Dim>(folder_ / nodes_.back().second, dynamics.nodes(),
                    {{"velocity", dynamics.velocities(), components},
                     {"mass", dynamics.masses().transpose()},
                     {"body", body_of_node}});
  write_series();
}

template <int Dim> void DynamicsRecord<Dim>::write_series() const {
  internal::write_series(folder_ / "points.pvd", points_);
  internal::write_series(folder_ / "nodes.pvd", nodes_);
}

template <int Dim> void DynamicsRecord<Dim>::add_line(const Dynamics<Dim>& dynamics, const Numbers& more) {
  Numbers line = history_numbers(dynamics);
  line.insert(line.end(), more.begin(), more.end());
  const std::size_t num_columns = columns_.size();
  std::vector<double> values(num_columns, 0.0);
  for (const auto& [name, value] : line) {
    const auto column = std::ranges::find(columns_, name);
    if (column == columns_.end()) {
      columns_.push_back(name);
      values.push_back(value);
    } else {
      values[static_cast<std::size_t>(column - columns_.begin())] = value;
    }
  }
  const bool has_new_columns = columns_.size() > num_columns;
  if (has_new_columns) {
    std::string zeros = "\n";
    for (std::size_t k = num_columns; k < columns_.size(); ++k) zeros.insert(0, ",0");
    for (std::size_t at = lines_.find('\n'); at != std::string::npos; at = lines_.find('\n', at + zeros.size()))
      lines_.replace(at, 1, zeros);
  }
  const std::string added = fmt::format("{}\n", fmt::join(values, ","));
  lines_ += added;
  if (has_new_columns) return write_history();
  std::ofstream out(folder_ / history_name, std::ios::app);
  out << added;
  if (!out.flush()) internal::cannot_write(folder_ / history_name);
}

template <int Dim> void DynamicsRecord<Dim>::write_history() const {
  std::ofstream out(folder_ / history_name, std::ios::trunc);
  std::vector<std::string> cells;
  std::ranges::transform(columns_, std::back_inserter(cells), internal::csv_cell);
  if (!cells.empty()) out << fmt::format("{}\n", fmt::join(cells, ",")) << lines_;
  if (!out.flush()) internal::cannot_write(folder_ / history_name);
}

template class DynamicsRecord<2>;
template class DynamicsRecord<3>;

}  // namespace efree
