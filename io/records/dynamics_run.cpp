// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/dynamics_run.hpp"

#include "efree/analysis/internal/located.hpp"
#include "efree/analysis/point_field.hpp"
#include "efree/assembly/kinematics.hpp"
#include "efree/core/error.hpp"
#include "efree/core/packer.hpp"
#include "efree/io/files/internal/cannot_write.hpp"
#include "efree/io/pictures/picture.hpp"
#include "efree/io/records/internal/animation.hpp"
#include "efree/io/records/internal/unfinished.hpp"
#include "efree/io/records/internal/vector_columns.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <regex>

namespace efree {
namespace fs = std::filesystem;

namespace {

constexpr std::string_view dynamics_state_kind = "efree dynamics 7\n";

/// Values of the probes, by columns.
template <int Dim> typename DynamicsRecord<Dim>::Numbers probe_columns(const DynamicsSettings<Dim>& settings,
                                                                       const DynamicsModel<Dim>& model) {
  constexpr const char* axes[] = {"x", "y", "z"};
  typename DynamicsRecord<Dim>::Numbers columns;
  for (const auto& [name, values] : measure_probes(settings, model)) {
    const std::string column = "probe." + name;
    if (values.size() == 1) {
      columns.emplace_back(column, values[0]);
      continue;
    }
    for (int i = 0; i < Dim; ++i) columns.emplace_back(fmt::format("{}.u{}", column, axes[i]), values[i]);
    for (int i = 0; i < Dim; ++i) columns.emplace_back(fmt::format("{}.v{}", column, axes[i]), values[Dim + i]);
  }
  return columns;
}

/// Forces of contact, by columns.
template <int Dim> void add_contact_columns(const ContactForces<Dim>& contacts, bool has_moments,
                                            typename DynamicsRecord<Dim>::Numbers& columns) {
  for (const auto& pair : contacts.pairs()) {
    internal::add_vector(fmt::format("contact.{}.force", pair.name()), pair.force, columns);
    if (has_moments) internal::add_vector(fmt::format("contact.{}.moment", pair.name()), pair.moment, columns);
  }
}

/// Whether energies, positions, velocities and all fields are finite.
template <int Dim> bool is_finite(const Dynamics<Dim>& dynamics) {
  const auto scalars = point_scalars(dynamics);
  return std::isfinite(dynamics.balance().total()) && std::isfinite(dynamics.energy().error()) &&
         dynamics.nodes().allFinite() && dynamics.velocities().allFinite() &&
         std::ranges::all_of(scalars, [](const auto& entry) { return entry.second.allFinite(); });
}

/// In the picture of material points those that have cells are drawn by these: in the plane each of them, in space the
/// surface. A node has the mean value of the cells around it.
template <int Dim> void show_cells(const Dynamics<Dim>& dynamics, DynamicsPicture<Dim>& picture) {
  const World<Dim>& world = dynamics.world();
  if (!dynamics.nodes_persist()) return;
  Vector volume = Vector::Zero(dynamics.num_nodes()), value = volume;
  std::vector<Index> others;
  for (Index b = 0; b < dynamics.num_bodies(); ++b) {
    const Cells<Dim>& cells = world.bodies[b].cells;
    for (Index p = world.first_point[b]; p < world.first_point[b + 1]; ++p) {
      if (cells.cols() == 0) others.push_back(p);
      if (cells.cols() == 0 || dynamics.is_eroded(p)) continue;
      const auto [chunk, k] = world.locate(p);
      std::array<Index, 3> triangle{};
      for (int i = 0; i <= Dim; ++i) {
        const Index node = world.nodes.master_of(world.first_node[b] + cells(i, p - world.first_point[b]));
        volume[node] += chunk.matter.volume[k];
        value[node] += chunk.matter.volume[k] * picture.values[p];
        if (i < 3) triangle[static_cast<std::size_t>(i)] = node;
      }
      if (Dim == 2) picture.skin.triangles.push_back(triangle);
    }
    if constexpr (Dim == 3) {
      const Facets<Dim> facets = outer_facets(world, b);
      for (const auto& facet : facets.colwise()) picture.skin.triangles.push_back({facet[0], facet[1], facet[2]});
    }
  }
  if (picture.skin.triangles.empty()) return;
  picture.skin.nodes = dynamics.nodes();
  picture.skin.values = (volume.array() > 0.0).select(value.cwiseQuotient(volume), picture.values.minCoeff());
  picture.points = Points<Dim>(picture.points(Eigen::all, others));
  picture.F = Tensors(picture.F(Eigen::all, others));
  for (Vector* of : {&picture.size, &picture.values}) *of = Vector((*of)(others));
}

constexpr double infinite = std::numeric_limits<double>::infinity();
constexpr std::array<double, 2> no_range{infinite, -infinite};
std::array<double, 2> united(const std::array<double, 2>& one, const std::array<double, 2>& other) {
  return {std::min(one[0], other[0]), std::max(one[1], other[1])};
}

/// Pictures of all frames begin with it.
std::string name_of_frames(const PictureOptions& options) {
  return options.name.empty() ? "frame" : "frame_" + options.name;
}

/// Name and values of the field that a picture shows: a scalar of the points, or one of the stress. By default it is
/// the plastic strain, else von Mises' stress.
template <int Dim>
std::pair<std::string, Vector> point_field(const Dynamics<Dim>& dynamics, const PictureOptions& options) {
  const auto scalars = point_scalars(dynamics);
  const std::vector<std::string> wanted = options.field.empty()
                                              ? std::vector<std::string>{"equivalent_plastic_strain", "von_mises"}
                                              : std::vector<std::string>{options.field};
  for (const std::string& name : wanted)
    for (const auto& scalar : scalars)
      if (scalar.first == name) return scalar;
  if (const auto field = PointField<3>::find(options.field, false); field && field->is_of_stress()) {
    const Tensors sigma = dynamics.cauchy_stress();
    Vector values(sigma.cols());
    for (Index p = 0; p < values.size(); ++p)
      values[p] = (*field)(Vec<3>::Zero(), Voigt<3>::Zero(), stress_of<3>(sigma.col(p)));
    return {options.field, values};
  }
  std::vector<std::string> names;
  for (const auto& [name, values] : scalars) names.push_back(name);
  throw InputError(internal::said_at(
      options.where, fmt::format("there is no field \"{}\"; the points have {}, stress_xx, ..., mean_stress, "
                                 "principal_stress_1 to principal_stress_3",
                                 options.field, fmt::join(names, ", "))));
}

template <int Dim> DynamicsPicture<Dim> picture_of(const DynamicsCase<Dim>& of, const DynamicsModel<Dim>& model,
                                                   const PictureOptions& options) {
  const Dynamics<Dim>& dynamics = model.dynamics;
  auto [field, values] = point_field(dynamics, options);
  const std::array<double, 2> extremes{values.minCoeff(), values.maxCoeff()};
  DynamicsPicture<Dim> picture{.points = dynamics.points(),
                               .F = dynamics.deformation(),
                               // Where there are other points, they get the mean size of those at the start.
                               .size = model.point_sizes.size() == dynamics.num_points()
                                           ? model.point_sizes
                                           : Vector::Constant(dynamics.num_points(), model.point_sizes.mean()),
                               .values = std::move(values),
                               .title = fmt::format("{}, time {:.4g}", of.common.title, dynamics.time()),
                               .options = options,
                               .extremes = extremes,
                               .view = model.initial_box,
                               .axisymmetric = of.common.model.plane == Plane::axisymmetric};
  picture.options.field = field;
  const Index num_points = dynamics.num_points();
  show_cells(dynamics, picture);
  if (const Vector& radius = dynamics.world().nodes.radius; dynamics.scheme() == "sph") {
    // Particles do not stretch with what flows past them.
    picture.size = 2.0 * radius;
    for (Index p = 0; p < num_points; ++p) picture.F.col(p) = Mat<3>::Identity().reshaped();
  }
  const Points<Dim> extent = model.probes_points ? dynamics.points() : dynamics.nodes();
  for (Index a = 0; a < extent.cols(); ++a) picture.view.extend(Vec<Dim>(extent.col(a)));
  if (picture.axisymmetric) {
    Vec<Dim> mirrored = picture.view.max();
    mirrored[0] = -mirrored[0];
    picture.view.extend(mirrored);
  }
  for (const auto& [wall, where] : of.walls) picture.walls.push_back(wall);
  const std::vector<RigidState<Dim>> states = dynamics.rigid_bodies();
  for (std::size_t k = 0; k < states.size(); ++k)
    picture.rigid_bodies.emplace_back([&body = of.rigid_bodies[k].body, state = states[k]](const Vec<Dim>& at) {
      return gap_to<Dim>(body, state, at).gap;
    });
  return picture;
}

/// Files of a run in a folder.
template <int Dim> std::vector<std::string> files_of_run(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (DynamicsRecord<Dim>::is_part(name) || name == dynamics_state_name) names.push_back(name);
  }
  return names;
}

}  // namespace

template <int Dim>
DynamicsRun<Dim>::DynamicsRun(fs::path directory, const DynamicsCase<Dim>& dynamics_case, bool pictures)
    : directory_(std::move(directory)),
      case_(dynamics_case),
      unfinished_(std::make_unique<internal::Unfinished>(directory_)) {
  if (pictures) pictures_ = case_.pictures.empty() ? std::vector<PictureOptions>(1) : case_.pictures;
  ranges_.assign(pictures_.size(), no_range);
}
template <int Dim> DynamicsRun<Dim>::~DynamicsRun() = default;

template <int Dim> bool DynamicsRun<Dim>::is_unfinished() const {
  return fs::exists(unfinished_->folder() / dynamics_state_name);
}

template <int Dim> void DynamicsRun<Dim>::begin() {
  if (record_) return;
  unfinished_->begin();
  for (const auto& entry : fs::directory_iterator(unfinished_->folder())) fs::remove_all(entry.path());
  record_.emplace(unfinished_->folder());
}

template <int Dim> void DynamicsRun<Dim>::resume(DynamicsModel<Dim>& model) {
  const bool was_killed = is_unfinished();
  const fs::path folder = was_killed ? unfinished_->folder() : directory_, file = folder / dynamics_state_name;
  if (!fs::exists(file))
    throw InputError(
        fmt::format("{}: there are no steps of an earlier run to resume: run without --resume", file.string()));
  const internal::Sealed sealed = internal::read_sealed(file, dynamics_state_kind, Dim, case_.mark);
  unfinished_->begin();
  std::string record;
  try {
    Unpacker unpack(sealed.packed());
    std::vector<std::array<double, 2>> ranges;
    unpack(record), unpack(contact_forces_), unpack(ranges);
    if (ranges.size() == ranges_.size()) ranges_ = ranges;
    model.dynamics.restore(unpack.rest());
    if (!is_finite(model.dynamics)) internal::is_damaged(file);
  } catch (const InputError&) {
    internal::is_damaged(file);
  }
  const double end = case_.end;
  if (const double now = model.dynamics.time(); now > end * (1.0 + 1e-12))
    throw InputError(internal::said_at(
        internal::where_said(case_.common, "time.end"),
        fmt::format("end is {:.6g}, and the steps of the earlier run are at {:.6g} already", end, now)));
  if (!was_killed)
    for (const std::string& name : files_of_run<Dim>(directory_))
      internal::link(directory_ / name, unfinished_->folder() / name);
  record_.emplace(unfinished_->folder(), record);
  remove_other_pictures();
}

/// Pictures of an earlier part of the run that are of other series.
template <int Dim> void DynamicsRun<Dim>::remove_other_pictures() {
  static const std::regex picture("(frame.*)_[0-9]{4,9}[.]png");
  for (const std::string& name : files_of_run<Dim>(unfinished_->folder())) {
    std::smatch match;
    if (std::regex_match(name, match, picture) &&
        std::ranges::find(pictures_, match[1].str(), name_of_frames) == pictures_.end())
      fs::remove(unfinished_->folder() / name);
  }
}

template <int Dim> void DynamicsRun<Dim>::add_bodies(const FineMesh<Dim>& mesh) {
  begin();
  record_->add_bodies(mesh);
}

template <int Dim> void DynamicsRun<Dim>::add_history_line(const DynamicsModel<Dim>& model) {
  begin();
  contact_forces_.add_line(model);
  auto columns = probe_columns<Dim>(case_, model);
  add_contact_columns<Dim>(contact_forces_, !model.dynamics.world().axisymmetric(), columns);
  record_->add_line(model.dynamics, columns);
}

template <int Dim> void DynamicsRun<Dim>::add_frame(const DynamicsModel<Dim>& model) {
  begin();
  const Index frame = record_->num_frames();
  record_->add_frame(model.dynamics);
  draw(model, frame);
}

template <int Dim> void DynamicsRun<Dim>::check_pictures(const DynamicsModel<Dim>& model) const {
  for (const PictureOptions& options : case_.pictures) point_field(model.dynamics, options);
}

template <int Dim> void DynamicsRun<Dim>::draw(const DynamicsModel<Dim>& model, Index frame) {
  for (std::size_t k = 0; k < pictures_.size(); ++k) {
    DynamicsPicture<Dim> picture = picture_of(case_, model, pictures_[k]);
    // The same colours for the same values as far as that can be known: the range only grows.
    const std::array<double, 2> range = range_of(picture);
    if (picture.extremes[0] < picture.extremes[1]) ranges_[k] = united(ranges_[k], range);
    if (!picture.options.range) picture.options.range = ranges_[k][0] < ranges_[k][1] ? ranges_[k] : range;
    draw_dynamics(unfinished_->folder() / fmt::format("{}_{:04}.png", name_of_frames(pictures_[k]), frame), picture);
  }
}

template <int Dim> void DynamicsRun<Dim>::write_checkpoint(const DynamicsModel<Dim>& model) {
  begin();
  std::string record = record_->state();
  ContactForces<Dim> forces = contact_forces_;
  std::vector<std::array<double, 2>> ranges = ranges_;
  Packer pack;
  pack(record), pack(forces), pack(ranges);
  internal::write_sealed(unfinished_->folder() / dynamics_state_name, dynamics_state_kind, Dim, case_.mark,
                         {std::move(pack).bytes(), model.dynamics.state()});
}

template <int Dim> std::string DynamicsRun<Dim>::finish(OutputDirectory& out) const {
  std::string none;
  if (!case_.animation.empty())
    for (const PictureOptions& options : pictures_)
      if (none.empty()) none = internal::animate(unfinished_->folder(), name_of_frames(options), case_.animation);
  for (const std::string& name : files_of_run<Dim>(directory_)) out.supersede(name);
  for (const std::string& name : files_of_run<Dim>(unfinished_->folder()))
    internal::link(unfinished_->folder() / name, out.file(name));
  return none;
}

template <int Dim> void DynamicsRun<Dim>::remove_unfinished() {
  unfinished_->forget();
}

template <int Dim> void read_state_start(DynamicsCase<Dim>& dynamics_case) {
  if (!dynamics_case.state_start) return;
  StateStart& start = *dynamics_case.state_start;
  try {
    const internal::Sealed sealed =
        internal::read_sealed(find_dynamics_state(start.directory), dynamics_state_kind, Dim, std::nullopt);
    Unpacker unpack(sealed.packed());
    std::string record;
    ContactForces<Dim> contact_forces;
    std::vector<std::array<double, 2>> ranges;
    unpack(record), unpack(contact_forces), unpack(ranges);
    start.state = unpack.rest();
  } catch (const InputError& error) {
    throw InputError(internal::said_at(start.where, error.what()));
  }
}

template void read_state_start(DynamicsCase<2>&);
template void read_state_start(DynamicsCase<3>&);
template class DynamicsRun<2>;
template class DynamicsRun<3>;

}  // namespace efree
