// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/dynamics/ledger.hpp"

#include <algorithm>
#include <cmath>

namespace efree {
namespace {

template <class Entries> auto find(Entries& entries, std::string_view name) {
  return std::ranges::find(entries, name, [](const auto& entry) { return std::string_view(entry.name); });
}

/// Adds to an entry's number; where there is no such entry, it is new.
template <class Entry, class Number> void add(std::vector<Entry>& entries, Entry entry, Number Entry::*number) {
  if (const auto found = find(entries, entry.name); found != entries.end())
    (*found).*number += entry.*number;
  else
    entries.push_back(std::move(entry));
}

template <class Entry, class Number>
Number value_of(const std::vector<Entry>& entries, std::string_view name, Number Entry::*number) {
  const auto found = find(entries, name);
  return found == entries.end() ? Number{} : (*found).*number;
}

}  // namespace

void Ledger::add_energy(std::string_view name, EnergyKind kind, double energy) {
  add(energies_, {std::string(name), kind, energy}, &Energy::value);
}
void Ledger::add_count(std::string_view name, std::int64_t count) {
  add(counts_, {std::string(name), count}, &Count::value);
}
void Ledger::set_count(std::string_view name, std::int64_t count) {
  add_count(name, count - this->count(name));
}
void Ledger::add_time(std::string_view name, double seconds) {
  add(times_, {std::string(name), seconds}, &Time::seconds);
}

double Ledger::energy(std::string_view name) const {
  return value_of(energies_, name, &Energy::value);
}
std::int64_t Ledger::count(std::string_view name) const {
  return value_of(counts_, name, &Count::value);
}
double Ledger::time(std::string_view name) const {
  return value_of(times_, name, &Time::seconds);
}

double Ledger::sum(EnergyKind kind) const {
  double result = 0.0;
  for (const Energy& entry : energies_)
    if (entry.kind == kind) result += entry.value;
  return result;
}

double Ledger::total() const {
  double result = 0.0;
  for (const Energy& entry : energies_) result += entry.kind == EnergyKind::work ? -entry.value : entry.value;
  return result;
}

void EnergyWatch::look(const Ledger& now) {
  // Energy gained where shape functions changed enters the balance as a loss below zero, and is an error.
  const double gained = std::max(0.0, -now.sum(EnergyKind::transfer)), total = now.total() + gained;
  // Loads and velocities that are prescribed between steps may bring energy: none of it is an error.
  if (!begun) start = total - residual;
  begun = true;
  scale = std::max(scale, now.sum(EnergyKind::kinetic) + std::abs(now.sum(EnergyKind::stored)) +
                              now.sum(EnergyKind::dissipated) - gained);
  for (const auto& entry : now.energies())
    if (entry.kind == EnergyKind::work) scale = std::max(scale, std::abs(entry.value));
  residual = total - start;
  if (!(std::abs(residual) <= std::abs(largest_residual))) largest_residual = residual;
}

}  // namespace efree
