// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/otm_record.hpp"

#include "efree/assembly/kinematics.hpp"
#include "efree/io/internal/cannot_write.hpp"
#include "efree/io/internal/series.hpp"
#include "efree/io/writers.hpp"

#include <fmt/format.h>
#include <Eigen/LU>
#include <fstream>
#include <map>
#include <regex>

namespace efree {
namespace fs = std::filesystem;
namespace {

constexpr const char* axes[] = {"x", "y", "z"};

std::string frame(const char* of, std::size_t number) {
  return fmt::format("{}_{:04}.vtu", of, number);
}

}  // namespace

template <int Dim> OtmRecord<Dim>::OtmRecord(fs::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (!fs::is_directory(folder_, error)) internal::cannot_write(folder_);
  static const std::regex ours(R"((points|nodes)(_[0-9]{4,9}\.vtu|\.pvd)|history\.csv)");
  for (const auto& entry : fs::directory_iterator(folder_, error))
    if (std::regex_match(entry.path().filename().string(), ours)) fs::remove(entry.path(), error);
}

template <int Dim> void OtmRecord<Dim>::add(const Otm<Dim>& otm) {
  const Tensors F = otm.deformation(), sigma = otm.cauchy_stress();
  const Index n = otm.num_points();
  Matrix stress(6, n), mises(1, n), J(1, n), of_point(1, n), of_node(1, otm.num_nodes());
  for (Index p = 0; p < n; ++p) {
    const Voigt<3> of = stress_of<3>(sigma.col(p));
    stress.col(p) = of;
    mises(0, p) = von_mises<3>(of);
    J(0, p) = Eigen::Map<const Mat<3>>(F.col(p).data()).determinant();
  }
  std::map<std::string, Matrix> scalars;  // zero where a body's material knows of none
  for (Index b = 0; b < otm.num_bodies(); ++b) {
    const Index first = otm.first_point(b), count = otm.first_point(b + 1) - first;
    of_point.middleCols(first, count).setConstant(b);
    of_node.middleCols(otm.first_node(b), otm.first_node(b + 1) - otm.first_node(b)).setConstant(b);
    const Matrix history = otm.history(b);
    for (const HistoryPart& part : otm.material(b).history_parts())
      if (part.size == 1)
        scalars.try_emplace(part.name, Matrix::Zero(1, n)).first->second.middleCols(first, count) =
            history.row(part.offset);
  }
  std::vector<PointValues> values{
      {"stress", stress, {"xx", "yy", "zz", "yz", "xz", "xy"}}, {"von_mises", mises}, {"J", J}, {"body", of_point}};
  for (const auto& [name, scalar] : scalars) values.push_back({name, scalar});
  const std::vector<std::string> components(axes, axes + Dim);
  points_.emplace_back(otm.time(), frame("points", points_.size()));
  nodes_.emplace_back(otm.time(), frame("nodes", nodes_.size()));
  write_points<Dim>(folder_ / points_.back().second, otm.points(), values);
  write_points<Dim>(
      folder_ / nodes_.back().second, otm.nodes(),
      {{"velocity", otm.velocities(), components}, {"mass", otm.masses().transpose()}, {"body", of_node}});
  internal::write_series(folder_ / "points.pvd", points_);
  internal::write_series(folder_ / "nodes.pvd", nodes_);
  note(otm);
}

template <int Dim> void OtmRecord<Dim>::note(const Otm<Dim>& otm) {
  const OtmBalance<Dim> now = otm.balance();
  const Points<Dim>& walls = otm.wall_forces();
  if (history_.empty()) {
    history_ = "t,steps,dt,kinetic,stored,dissipated,stabilising,contact,renewal,prescribed,total";
    for (int i = 0; i < Dim; ++i) history_ += fmt::format(",momentum.{}", axes[i]);
    for (int i = 0; i < now.moment.size(); ++i) history_ += fmt::format(",moment.{}", axes[Dim == 2 ? 2 : i]);
    for (Index w = 0; w < walls.cols(); ++w)
      for (int i = 0; i < Dim; ++i) history_ += fmt::format(",wall.{}.{}", w, axes[i]);
    history_ += '\n';
  }
  history_ +=
      fmt::format("{},{},{},{},{},{},{},{},{},{},{}", otm.time(), otm.counts().steps, otm.stable_step(), now.kinetic,
                  now.stored, now.dissipated, now.stabilising, now.contact, now.renewal, now.prescribed, now.total());
  for (int i = 0; i < Dim; ++i) history_ += fmt::format(",{}", now.momentum[i]);
  for (int i = 0; i < now.moment.size(); ++i) history_ += fmt::format(",{}", now.moment[i]);
  for (Index w = 0; w < walls.cols(); ++w)
    for (int i = 0; i < Dim; ++i) history_ += fmt::format(",{}", walls(i, w));
  history_ += '\n';
  const fs::path file = folder_ / "history.csv";
  std::ofstream out(file);
  out << history_;
  if (!out.flush()) internal::cannot_write(file);
}

template class OtmRecord<2>;
template class OtmRecord<3>;

}  // namespace efree
