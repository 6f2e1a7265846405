// SPDX-License-Identifier: GPL-3.0-or-later
/// Makes what the case files of the examples read: example_inputs FOLDER. These are copied beside it.
///
/// porous.pgm     a square of 256 x 256 pixels with overlapping discs cut out of it
/// part.mha       a bar of 72 x 24 x 24 voxels as a scanner sees it: rough skin, some pores
/// assembly.step  a plate with a pin through it, two bodies
/// dirty.stl      an angle of two overlapping boxes, some of whose triangles are missing, doubled or turned over
/// block.mha      a block of 64 x 64 x 64 voxels with overlapping balls cut out of it
#include <cmath>
#include <cstdio>
#include <efree/efree.hpp>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <random>

using namespace efree;
namespace fs = std::filesystem;

namespace {

void porous_image(const fs::path& file) {
  write_image(random_spheres<2>(256, {.porosity = 0.3, .r_min = 3.0, .r_max = 12.0, .seed = 3}), file.string());
}

void scanned_part(const fs::path& file) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> number(0.0, 1.0);
  struct Wave {
    double along;
    int around;
    double phase;
  };
  std::vector<Wave> waves;
  for (int k = 0; k < 12; ++k) waves.push_back({0.9 * number(random), 1 + k % 5, 6.28 * number(random)});
  std::vector<Vec<4>> pores;  // centre and radius
  for (int k = 0; k < 12; ++k)
    pores.emplace_back(6 + 60 * number(random), 7 + 10 * number(random), 7 + 10 * number(random),
                       1.5 + 1.5 * number(random));
  LabelImage<3> image{.size = {72, 24, 24}, .spacing = {0.5, 0.5, 0.5}};
  for (int z = 0; z < 24; ++z)
    for (int y = 0; y < 24; ++y)
      for (int x = 0; x < 72; ++x) {
        const Vec<3> at(x + 0.5, y + 0.5, z + 0.5);
        const double angle = std::atan2(at.z() - 12, at.y() - 12);
        double radius = 9.0;
        for (const Wave& wave : waves) radius += 0.3 * std::sin(wave.along * at.x() + wave.around * angle + wave.phase);
        bool inside = std::hypot(at.y() - 12, at.z() - 12) < radius;
        for (const auto& pore : pores) inside = inside && (at - pore.head<3>()).norm() > pore[3];
        image.labels.push_back(inside);
      }
  write_image(keep_largest(image).image, file.string());
}

/// gmsh writes the STEP file while it reads this script of ours.
void assembly(const fs::path& file) {
  const fs::path script = fs::path(file).replace_extension(".geo");
  std::ofstream(script) << "SetFactory(\"OpenCASCADE\");\n"
                           "Box(1) = {0, 0, 0, 40, 30, 6};\n"
                           "Cylinder(2) = {12, 15, -4, 0, 0, 22, 5};\n"
                           "Cylinder(3) = {12, 15, -4, 0, 0, 22, 5};\n"
                           "BooleanDifference(4) = { Volume{1}; Delete; }{ Volume{2}; Delete; };\n"
                           "Save \""
                        << file.filename().string() << "\";\n";
  read_gmsh<3>(script.string(), {.size = 10.0, .trust = true});
  fs::remove(script);
}

/// A box of triangles no longer than about 0.08, each left out, doubled or turned over now and then.
void dirty_box(std::ofstream& stl, std::mt19937& random, const Vec<3>& low, const Vec<3>& size) {
  std::uniform_real_distribution<double> number(0.0, 1.0);
  for (int d = 0; d < 3; ++d)
    for (const double side : {0.0, 1.0}) {
      const int u = (d + 1) % 3, v = (d + 2) % 3;
      const int nu = static_cast<int>(std::ceil(size[u] / 0.08)), nv = static_cast<int>(std::ceil(size[v] / 0.08));
      const auto corner = [&](int i, int j) {
        Vec<3> x = low;
        x[d] += side * size[d];
        x[u] += size[u] * i / nu;
        x[v] += size[v] * j / nv;
        return x;
      };
      for (int i = 0; i < nu; ++i)
        for (int j = 0; j < nv; ++j)
          for (const bool upper : {false, true}) {
            std::array<Vec<3>, 3> triangle{corner(i, j), upper ? corner(i + 1, j + 1) : corner(i + 1, j),
                                           upper ? corner(i, j + 1) : corner(i + 1, j + 1)};
            const double fate = number(random);
            if (fate < 0.02) continue;
            if (fate > 0.9) std::swap(triangle[0], triangle[1]);
            for (int copies = fate > 0.98 ? 2 : 1; copies > 0; --copies) {
              stl << "facet normal 0 0 0\nouter loop\n";
              for (const Vec<3>& x : triangle) stl << "vertex " << x[0] << ' ' << x[1] << ' ' << x[2] << '\n';
              stl << "endloop\nendfacet\n";
            }
          }
    }
}

void dirty_surface(const fs::path& file) {
  std::mt19937 random(5);
  std::ofstream stl(file);
  stl << "solid angle\n";
  dirty_box(stl, random, {0, 0, 0}, {3, 1, 0.5});
  dirty_box(stl, random, {0, 0.03, 0.2}, {0.5, 0.94, 2});
  stl << "endsolid angle\n";
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s FOLDER\n", argv[0]);
    return 2;
  }
  std::cout.rdbuf(nullptr);  // OpenCASCADE's statistics of what it writes
  const fs::path folder = fs::absolute(argv[1]);
  fs::create_directories(folder);
  porous_image(folder / "porous.pgm");
  scanned_part(folder / "part.mha");
  write_image(random_spheres<3>(64, {.porosity = 0.3, .r_min = 5.0, .r_max = 12.0}), (folder / "block.mha").string());
  assembly(folder / "assembly.step");
  dirty_surface(folder / "dirty.stl");
  for (const char* name : {"porous_image", "scanned_part", "step_assembly", "dirty_surface", "porous_block"})
    for (const auto& file : fs::directory_iterator(fs::path(EFREE_EXAMPLES) / name)) {
      const std::string stem = file.path().stem().string(), more = stem == "case" ? "" : "_" + stem;
      fs::copy_file(file, folder / (name + more + ".toml"), fs::copy_options::overwrite_existing);
    }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
