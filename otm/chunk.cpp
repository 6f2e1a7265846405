// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/otm/internal/chunk.hpp"

#include <utility>

namespace efree::internal {
namespace {

// What there is of every point, for points that go on as those.

template <int R> void gather(Eigen::Matrix<double, R, Eigen::Dynamic>& columns, const std::vector<Index>& from) {
  if (columns.cols() != 0) columns = columns(Eigen::all, from).eval();
}
void gather(Vector& values, const std::vector<Index>& from) {
  if (values.size() != 0) values = values(from).eval();
}
template <class T> void gather(std::vector<T>& values, const std::vector<Index>& from) {
  std::vector<T> result;
  result.reserve(from.size());
  for (const Index p : from) result.push_back(values[p]);
  values = std::move(result);
}

}  // namespace

template <int Dim> void OtmChunk<Dim>::take(const std::vector<Index>& from) {
  std::vector<Index> first(size() + 1);  // of the points that were so far, how many there are now
  for (const Index p : from) ++first[p + 1];
  for (Index p = 0; p < size(); ++p) first[p + 1] += first[p];
  std::vector<Index> new_offsets{0};
  std::vector<std::uint16_t> new_local;
  OtmTable<OtmEntry> new_entries;
  for (const Index p : from) {
    new_local.insert(new_local.end(), local.begin() + offsets[p], local.begin() + offsets[p + 1]);
    new_entries.insert(new_entries.end(), entries.begin() + offsets[p], entries.begin() + offsets[p + 1]);
    new_offsets.push_back(static_cast<Index>(new_entries.size()));
  }
  offsets = std::move(new_offsets);
  local = std::move(new_local);
  entries = std::move(new_entries);
  gather(number, from);
  gather(now.X, from);
  gather(now.F, from);
  gather(now.history, from);
  gather(now.heat, from);
  gather(response.P, from);
  gather(response.history, from);
  gather(response.energy, from);
  gather(response.A, from);
  gather(response.dissipated, from);
  gather(made, from);
  gather(since, from);
  gather(at, from);
  for (Vector* values :
       {&volume, &mass, &count, &width, &growth, &dilatation, &shock, &modulus, &stiffening, &penalty, &damage, &reach})
    gather(*values, from);
  gather(metric, from);
  gather(moment, from);
  gather(lambda, from);
  for (Index& begin : unions) begin = first[begin];
  unions.erase(std::unique(unions.begin(), unions.end()), unions.end());
  for (std::vector<Index>* points : {&worn, &stiffened, &crushed}) {
    std::vector<Index> result;
    for (const Index p : *points)
      for (Index q = first[p]; q < first[p + 1]; ++q) result.push_back(q);
    *points = std::move(result);
  }
}

template <int Dim> void OtmChunk<Dim>::add_tables(std::vector<std::span<const std::byte>>& tables) const {
  const auto add = [&](const auto& of) { tables.push_back(std::as_bytes(std::span(of.data(), of.size()))); };
  add(entries);
  add(local);
  for (const Tensors* of : {&now.F, &response.P, &made}) add(*of);
  for (const Matrix* of : {&now.history, &response.history}) add(*of);
  add(since);
  add(metric);
  add(moment);
}

template struct OtmChunk<2>;
template struct OtmChunk<3>;

}  // namespace efree::internal
