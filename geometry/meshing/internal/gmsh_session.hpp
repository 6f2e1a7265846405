// SPDX-License-Identifier: GPL-3.0-or-later
/// What the parts of this room that use gmsh share: a session of it, sizes, and the mesh that it holds.
#pragma once

#include "efree/geometry/mesh/boundary_offsets.hpp"

#include <set>
#include <string>
#include <utility>
#include <vector>

namespace efree::internal {

/// gmsh between initialize and finalize. Errors are read from its log: left to throw, they would leave gmsh's parser in
/// a state in which it reads no other file. One at a time, in one thread.
class GmshSession {
 public:
  /// `subject` begins every message: a path, or the name of a shape.
  explicit GmshSession(std::string subject);
  ~GmshSession();
  GmshSession(const GmshSession&) = delete;
  GmshSession& operator=(const GmshSession&) = delete;

  /// Throws InputError with gmsh's first complaint so far, if any.
  void check() const;
  void open(const std::string& path) const;
  /// Triangulates curves (1), surfaces (2), volumes (3).
  void generate(int dim) const;
  /// Drops the mesh and what gmsh has complained of; the geometry stays.
  void forget() const;
  [[noreturn]] void fail(const std::string& what) const;

 private:
  std::string subject_;
  int threads_;  ///< gmsh sets our number to one
};

double gmsh_option(const std::string& name);

/// A part of the model that is to be a region or a group: entities of one dimension, ascending.
struct GmshPart {
  std::string name;
  std::set<int> entities;
};
/// Physical groups of a dimension, ascending by name; one without a name goes by its number.
std::vector<GmshPart> physical_parts(int dim);
/// Tags of all entities of a dimension, ascending.
std::set<int> all_entities(int dim);
/// A name for each entity: the last part of the label it has in the file ("nut" of "Shapes/assembly/nut"), numbered if
/// several have it ("nut 1", "nut 2"); without a label `fallback` and the entity's number.
std::vector<GmshPart> named_entities(int dim, const std::string& fallback);

/// What the regions of the mesh are: physical surfaces or volumes. Without any, one region without a name (2D, all
/// surfaces) or one for each volume (3D). Fails if an entity belongs to two.
std::vector<GmshPart> region_parts(const GmshSession& session, int dim);

/// gmsh's Delaunay refinement leaves edges up to twice as long as it was told to make them. Asking for a little finer
/// and splitting what is still too long is faster than asking for half (a cube with 1.6e6 tetrahedra: 9 s against
/// 60 s), at the same mean edge, 0.63 of the longest.
constexpr double finer_than_told = 1.2;

/// Refuses a size that no machine could mesh before gmsh begins to sample the curves.
void check_gmsh_size(const GmshSession& session, double size);

/// Has gmsh make at least so many elements to a full revolution of curves and curved surfaces, whatever the factor on
/// its sizes.
void require_elements_per_turn(double elements);

/// Tetrahedra for all volumes, fast and careless: Delaunay, no optimisation, at least 16 elements to a full turn of a
/// curved surface. size > 0: at most that, with the finer sizes that the model has; 0: the model's own. `sagitta` > 0:
/// fine enough for thin curved walls (mesh_with_walls). One thread.
void generate_tetrahedra(const GmshSession& session, double size, double sagitta = 0.0);

/// Coordinates of mesh nodes by gmsh's tags. In 2D the nodes asked for must lie in one plane z = const.
template <int Dim> class GmshNodes {
 public:
  explicit GmshNodes(const GmshSession& session);
  std::size_t size() const { return static_cast<std::size_t>(points_.cols()); }
  Vec<Dim> at(std::size_t tag);

 private:
  const GmshSession& session_;
  Points<3> points_;
  double extent_ = 0.0, z_ = 0.0;
  bool has_plane_ = false;
};

/// Corner nodes of all simplices of an entity, dim + 1 after dim + 1.
std::vector<std::size_t> gmsh_simplices(int dim, int entity);

/// The highest order of the simplices of this dimension; 0 if there are none.
int highest_order(int dim);

/// Reads the mesh that gmsh holds, splits edges longer than `size` (0: none), and cuts it open along the physical
/// curves (surfaces in 3D) named in `slits`. Coordinates are divided by `unit`, after `size` has been compared.
template <int Dim> CurvedMesh<Dim> gmsh_mesh(const GmshSession& session, double size,
                                             const std::vector<std::string>& slits, double unit = 1.0);
/// The same as it is, without offsets.
template <int Dim> MeshData<Dim> flat_gmsh_mesh(const GmshSession& session);

}  // namespace efree::internal
