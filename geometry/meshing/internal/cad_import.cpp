// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/cad_import.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/reading_bound.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmsh.h>
#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>

namespace efree::internal {
namespace {

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

double unit_length(const std::string& path, const std::map<std::string, double>& units, const std::string& key) {
  const auto unit = units.find(key);
  if (unit == units.end())
    throw InputError(
        fmt::format("{}: the length unit \"{}\" is not known; export the file in millimetres or metres", path, key));
  return unit->second;
}

constexpr double inch = 25.4;

/// The text of an entity of a STEP file without blanks, from ";#12=" to the next semicolon; empty if there is none.
std::string step_entity(const std::string& text, const std::string& number) {
  const std::size_t at = text.find(';' + number + '=');
  return at == std::string::npos ? "" : text.substr(at, text.find(';', at + 1) - at);
}

/// A unit of length of a STEP file: an SI unit, or one that is a multiple of another unit, by the factor the file gives
/// (ISO 10303-41; its name may be any, e.g. 'CENTIMETRE').
double step_length(const std::string& path, const std::string& text, const std::string& entity, int depth = 0) {
  const std::string converted = "CONVERSION_BASED_UNIT('", si = "SI_UNIT(", measure = "LENGTH_MEASURE(";
  if (const std::size_t at = entity.find(converted); at != std::string::npos) {
    const std::size_t begin = at + converted.size(), quote = std::min(entity.find('\'', begin), entity.size());
    if (entity.compare(quote, 2, "',") == 0 && depth < 8) {
      const std::size_t end = std::min(entity.find(')', quote), entity.size());
      const std::string factor = step_entity(text, entity.substr(quote + 2, end - quote - 2));
      if (const std::size_t value = factor.find(measure); value != std::string::npos)
        if (const std::size_t unit = factor.find("),", value); unit != std::string::npos) {
          const double times = std::strtod(factor.c_str() + value + measure.size(), nullptr);
          const std::string of = step_entity(text, factor.substr(unit + 2, factor.find(')', unit + 2) - unit - 2));
          if (times > 0.0 && !of.empty()) return times * step_length(path, text, of, depth + 1);
        }
    }
    return unit_length(path,
                       {{"INCH", inch},
                        {"FOOT", 12.0 * inch},
                        {"MILE", 63360.0 * inch},
                        {"MIL", 1e-3 * inch},
                        {"MILLIMETRE", 1.0},
                        {"CENTIMETRE", 10.0},
                        {"METRE", 1000.0}},
                       upper(entity.substr(begin, quote - begin)));
  }
  const std::size_t prefix = entity.find(si);
  if (prefix == std::string::npos) return unit_length(path, {}, entity);
  const std::size_t begin = prefix + si.size();
  return unit_length(path,
                     {{"$", 1000.0},
                      {".MILLI.", 1.0},
                      {".CENTI.", 10.0},
                      {".DECI.", 100.0},
                      {".KILO.", 1e6},
                      {".MICRO.", 1e-3},
                      {".NANO.", 1e-6}},
                     entity.substr(begin, entity.find(',', begin) - begin));
}

/// ISO 10303-21: the unit is named by the first GLOBAL_UNIT_ASSIGNED_CONTEXT that names a LENGTH_UNIT.
double step_unit(const std::string& path, std::istream& file) {
  std::string text{std::istreambuf_iterator<char>(file), {}};
  std::erase_if(text, [](unsigned char c) { return std::isspace(c); });
  const std::string context = "GLOBAL_UNIT_ASSIGNED_CONTEXT((";
  for (std::size_t at = text.find(context); at != std::string::npos; at = text.find(context, at)) {
    at += context.size();
    const std::size_t end = text.find(')', at);
    while (at < end) {
      const std::size_t next = std::min(text.find(',', at), end);
      const std::string entity = step_entity(text, text.substr(at, next - at));
      at = next + 1;
      if (entity.find("LENGTH_UNIT()") != std::string::npos) return step_length(path, text, entity);
    }
  }
  return 1.0;
}

/// IGES 5.3, section 2.2.4.3: parameter 14 of the global section, the lines with a G in column 73.
double iges_unit(const std::string& path, std::istream& file) {
  std::string global;
  for (std::string line; std::getline(file, line);)
    if (line.size() > 72 && line[72] == 'G') global += line.substr(0, 72);
  std::vector<std::string> parameters;
  char separator = ',';
  for (std::size_t at = 0; at < global.size() && parameters.size() < 14;) {
    std::size_t digits = at;
    while (digits < global.size() && std::isdigit(static_cast<unsigned char>(global[digits]))) ++digits;
    if (digits > at && digits < global.size() && global[digits] == 'H') {  // a string: its length, H, its characters
      const std::size_t length = std::stoul(global.substr(at, std::min<std::size_t>(digits - at, 6)));
      parameters.push_back(global.substr(digits + 1, length));
      if (parameters.size() == 1 && length == 1) separator = parameters[0][0];
      at = digits + 1 + length + 1;
    } else {
      const std::size_t end = std::min(global.find(separator, at), global.size());
      parameters.push_back(global.substr(at, end - at));
      at = end + 1;
    }
  }
  if (parameters.size() < 14) return 1.0;
  std::erase(parameters[13], ' ');
  return unit_length(path,
                     {{"", inch},
                      {"1", inch},
                      {"2", 1.0},
                      {"4", 12.0 * inch},
                      {"5", 63360.0 * inch},
                      {"6", 1000.0},
                      {"7", 1e6},
                      {"8", 1e-3 * inch},
                      {"9", 1e-3},
                      {"10", 10.0},
                      {"11", 1e-6 * inch}},
                     parameters[13]);
}

/// Of a file, in millimetres.
double declared_unit(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string extension = upper(path.substr(path.rfind('.') + 1));
  if (extension == "STEP" || extension == "STP") return step_unit(path, file);
  if (extension == "IGES" || extension == "IGS") return iges_unit(path, file);
  return 1.0;
}

}  // namespace

double import_cad(const GmshSession& session, const std::string& path) {
  gmsh::vectorpair shapes;
  {
    const ReadingTime bound(path);
    gmsh::model::occ::importShapes(path, shapes, /*highestDimOnly=*/true);
  }
  session.check();
  if (!shapes.empty() && shapes.front().first == 2) {
    gmsh::vectorpair sewn;
    gmsh::model::occ::healShapes(sewn, shapes, 1e-8, false, false, false, /*sewFaces=*/true, /*makeSolids=*/true);
    session.check();
  }
  gmsh::model::occ::synchronize();
  const std::vector<GmshPart> bodies = named_entities(3, "body");
  if (bodies.empty()) session.fail("there is no body in it, nor surfaces that close to one");
  std::map<int, std::vector<std::string>> owners;  // of every volume
  if (bodies.size() == 1)
    owners[*bodies[0].entities.begin()] = {bodies[0].name};
  else {
    gmsh::vectorpair volumes, pieces;
    for (const GmshPart& body : bodies) volumes.emplace_back(3, *body.entities.begin());
    std::vector<gmsh::vectorpair> pieces_of;
    gmsh::model::occ::fragment(volumes, {}, pieces, pieces_of);
    session.check();
    gmsh::model::occ::synchronize();
    for (std::size_t b = 0; b < bodies.size(); ++b)
      for (const auto& [dim, piece] : pieces_of[b])
        if (dim == 3) owners[piece].push_back(bodies[b].name);
  }
  std::map<std::string, std::vector<int>> regions;
  for (const auto& [volume, names] : owners) regions[fmt::format("{}", fmt::join(names, " & "))].push_back(volume);
  for (const auto& [name, volumes] : regions)
    gmsh::model::setPhysicalName(3, gmsh::model::addPhysicalGroup(3, volumes), name);
  return declared_unit(path);
}

}  // namespace efree::internal
