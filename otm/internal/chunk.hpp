// SPDX-License-Identifier: GPL-3.0-or-later
/// Some hundred material points that lie together, with the nodes they see: what one thread works on at a time.
#pragma once

#include "efree/otm/otm.hpp"

#include <algorithm>
#include <boost/align/aligned_allocator.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace efree::internal {

/// What kernels read or write four numbers at a time, none of which lie in two lines of the cache.
template <class T> using OtmTable = std::vector<T, boost::alignment::aligned_allocator<T, 64>>;

/// A node in a point's row: the gradient of its function in the configuration where the functions were made, and the
/// function. In the plane the third component is the function over the radius (axisymmetric), or zero.
struct OtmEntry {
  double dN[3];
  double N;
};

/// Functions that sum up to one and gradients that sum up to nothing, to far below rounding: what is missing is added
/// to the smallest that is no smaller than a thousandth of the largest. Forces of a point would sum up to something
/// else, and to the same in every step. entry(k): that of the k-th node, of `count`.
template <int Dim, class Entry> void otm_complete(std::size_t count, const Entry& entry) {
  const auto complete = [&](double whole, const auto& number) {
    double largest = 0.0, sum = -whole, rest = 0.0;  // the sum of both is exact (Neumaier 1974)
    for (std::size_t k = 0; k < count; ++k) {
      const double more = number(entry(k)), next = sum + more;
      rest += std::abs(sum) >= std::abs(more) ? (sum - next) + more : (more - next) + sum;
      sum = next;
      largest = std::max(largest, std::abs(more));
    }
    double* least = nullptr;
    for (std::size_t k = 0; k < count; ++k)
      if (double& of = number(entry(k)); std::abs(of) >= 1e-3 * largest && (!least || std::abs(of) < std::abs(*least)))
        least = &of;
    if (least) *least -= sum + rest;
  };
  complete(1.0, [](OtmEntry& of) -> double& { return of.N; });
  for (int i = 0; i < Dim; ++i) complete(0.0, [i](OtmEntry& of) -> double& { return of.dN[i]; });
}

/// What two points do.
enum class OtmPairing {
  move,  ///< come apart, as they were one, or nearer to each other; their centre of mass stays
  fuse,  ///< both go to their centre of mass, and the first has it all
  join,  ///< the second goes to the first and takes its functions; it keeps its mass and what it has felt
};

/// Two points whose momentum, and its moment, are handed over together.
template <int Dim> struct OtmPair {
  Index first, second;
  Vec<Dim> way = Vec<Dim>::Zero();  ///< that the first goes where they move
  OtmPairing pairing = OtmPairing::move;
  bool fuses() const { return pairing == OtmPairing::fuse; }
};

template <int Dim> struct OtmChunk {
  Index body = 0;
  std::vector<Index> number;  ///< of the points, in their body

  // Functions. Row p: entries offsets[p] .. offsets[p + 1], of the nodes that `local` numbers.
  std::vector<Index> offsets{0};
  std::vector<std::uint16_t> local;
  OtmTable<OtmEntry> entries;
  std::vector<Index> nodes;            ///< by local number
  OtmTable<double> x, force;           ///< four numbers for each of these; x: from `origin` on
  Vec<Dim> origin = Vec<Dim>::Zero();  ///< near them, so that no place is a small difference of large numbers

  // Points.
  Deformation now;                  ///< X, F, history
  MaterialResponse response;        ///< to it
  Tensors made;                     ///< F when the functions were made
  std::vector<Mat<3>> since;        ///< F since then
  Points<Dim> at;                   ///< where they are
  Vector volume, mass;              ///< in the reference configuration; the volume of eroded points is 0
  std::vector<Mat<Dim>> metric;     ///< that the functions were made with
  std::vector<Mat<Dim>> moment;     ///< J of them
  std::vector<Vec<Dim>> lambda;     ///< of them
  Vector count;                     ///< nodes each saw at first
  Vector width;                     ///< of its functions at first, where they were narrowest
  Vector growth;                    ///< J, over that of the union
  Vector dilatation;                ///< J, of the union
  Vector shock;                     ///< viscous pressure times J
  Vector modulus;                   ///< of pressure waves
  Vector stiffening;                ///< how many times stiffer than at rest, at the most
  Vector penalty;                   ///< on motions that points do not see [force/length]
  Vector damage;                    ///< 1: it breaks
  Vector reach;                     ///< radius of the ball that releases energy with it
  std::vector<Index> unions;        ///< where each union of points begins, and the end of the last
  std::vector<Index> worn;          ///< points whose functions are to be renewed, ascending
  std::vector<Index> stiffened;     ///< those of them whose new functions are stiffer
  std::vector<Index> crushed;       ///< those of them that would have been turned inside out, and are held till then
  std::vector<OtmPair<Dim>> pairs;  ///< of worn points; none that moves or fuses is in two
  double damping = 0.0;             ///< viscous pressure over that of sound, at the most
  double squeeze = 0.0;             ///< rate of compression, at the most
  double lost = 0.0;  ///< in this step: work of crushed points that nothing has stored, less what points keep unseen
  OtmTimes seconds;   ///< kinematics, materials, forces

  Index size() const { return now.size(); }
  bool is_eroded(Index p) const { return volume[p] == 0.0; }
  bool is_crushed(Index p) const { return std::binary_search(crushed.begin(), crushed.end(), p); }
  /// The point's functions are to be renewed.
  void wear(Index p) {
    const auto place = std::lower_bound(worn.begin(), worn.end(), p);
    if (place == worn.end() || *place != p) worn.insert(place, p);
  }
  /// Where it is in `worn`.
  std::size_t worn_place(Index p) const {
    return static_cast<std::size_t>(std::lower_bound(worn.begin(), worn.end(), p) - worn.begin());
  }
  /// Points go on as those of `from`, ascending, of which some may be left out and some may be there twice.
  void take(const std::vector<Index>& from);
  /// Sixteen numbers a point, what kernels hand over: of this thread, for whatever chunk it works on, so that they stay
  /// near it.
  double* columns() const {
    thread_local OtmTable<double> room;
    room.resize(std::max(room.size(), 16 * static_cast<std::size_t>(size())));
    return room.data();
  }
  /// The largest of what there is of the points.
  void add_tables(std::vector<std::span<const std::byte>>& tables) const;
  /// Whether there are unions of more than one point.
  bool shares_dilatation() const { return static_cast<Index>(unions.size()) != size() + 1; }
};

/// What kernels hand over for a point are four columns of four numbers. Here: sums over the nodes of every point of
/// each component of x_a (three rows of four numbers) times dN_a and N_a, and in the fourth column those times N_a,
/// where the point is.
void otm_deform(Index points, const Index* offsets, const std::uint16_t* local, const OtmEntry* entries,
                const double* x, double* columns);
/// What stands across the plane in a gradient: there is no plane, one, or the sum around the axis.
enum class OtmPlane { none, strain, axisymmetric };
/// What points have gone through, those that have gone through most of it.
struct OtmStrains {
  double wear = 0.0;    ///< norm of Green's strain since the functions were made, at the most
  double shrunk = 1.0;  ///< volume a step ago over that now, at the most; of no meaning unless regular
  bool regular = true;  ///< whether every J is positive, and more than the least is left of every volume
};
/// From those rows, of points that have a volume: `since`, and F = since made where J is positive and more than that
/// is left of the volume a step ago; else F stays. J is its growth. In the place of the rows go the nine numbers of
/// `since` before, the norm of Green's strain of `since`, and its determinant over that before.
OtmStrains otm_kinematics(Index points, OtmPlane plane, double least, const double* volume, const double* made,
                          Mat<3>* since, double* F, double* growth, double* columns);
/// F over the cube root of its growth, of points that have a volume.
void otm_share(Index points, const double* growth, const double* volume, double* F);
/// Those below write the first three columns.
/// Kirchhoff stresses P F^T, less a pressure.
void otm_kirchhoff(Index points, const double* P, const double* F, const double* shock, double* columns);
/// moved since^-1.
void otm_rates(Index points, const Mat<3>* moved, const Mat<3>* since, double* columns);
/// A factor for each point times a tangent, nine columns of three times three numbers and a zero, times what stands
/// there.
void otm_stiffness(Index points, const double* tangent, const double* factor, double* columns);
/// How many times stiffer than at rest points are, by their tangents (nine columns of nine numbers) and the compliance
/// at rest (as tangents of otm_stiffness): the largest eigenvalue of one by the other, nearly, by power iteration; at
/// least one. And their moduli of pressure waves, the largest along an axis, where they are positive.
void otm_stiffening(Index points, const double* tangents, const double* F, const double* compliance, double* stiffening,
                    double* modulus);
/// From Kirchhoff stresses and places what otm_push takes: -volume tau since^-T + penalty moved moment, and penalty
/// times place.
void otm_tractions(Index points, const double* volume, const Mat<3>* since, const Mat<3>* moved, const Mat<2>* moment,
                   const double* penalty, double* columns);
void otm_tractions(Index points, const double* volume, const Mat<3>* since, const Mat<3>* moved, const Mat<3>* moment,
                   const double* penalty, double* columns);
/// force_a += columns dN_a + N_a (fourth column - penalty x_a) over all points; force is zero before. Forces of a point
/// sum up to nothing beyond rounding, but those along the radius around an axis.
void otm_push(Index points, const Index* offsets, const std::uint16_t* local, const OtmEntry* entries, const double* x,
              const double* columns, const double* penalty, bool around_axis, double* force);
/// Least changes of the weights of every point that multipliers on sums over points of volumes times gradients ask for,
/// such that weights go on to sum up to one and to have their mean at the point, to first order; and their second
/// moments. Nodes, their multipliers and points have four numbers each, those in the plane a zero along z; but around
/// an axis multipliers have there what they have along the radius. inverse: of second moments of the weights.
void otm_weight_changes(Index points, const Index* offsets, const std::uint16_t* local, const OtmEntry* entries,
                        const double* x, const double* at, const Mat<3>* inverse, const double* volume,
                        bool around_axis, const double* multipliers, double* changes, Mat<3>* moment);
/// Adds what these do to those sums, to first order.
void otm_gradient_changes(Index points, const Index* offsets, const std::uint16_t* local, const OtmEntry* entries,
                          const double* x, const double* at, const Mat<3>* inverse, const double* volume,
                          bool around_axis, const double* changes, const Mat<3>* moment, double* sums);

}  // namespace efree::internal
