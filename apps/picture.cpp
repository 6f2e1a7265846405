// SPDX-License-Identifier: GPL-3.0-or-later
// efree-picture FIELDS.vtu PICTURE.png: von Mises stress on the deformed body, the undeformed one behind it, and where
// it is held and loaded (point data "restrained" and "loaded", if there).
// efree-picture --geometry MESH.vtu PICTURE.png: regions and named parts of the boundary (cell data "region" and
// "group", names in the field data "region_names" and "group_names").
// Uses the X display there is, or an Xvfb of its own where it is missing or dead. Exit status 1 with a message if there
// is neither.
#include "virtual_display.hpp"

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vtkActor.h>
#include <vtkActor2D.h>
#include <vtkAxesActor.h>
#include <vtkCamera.h>
#include <vtkCaptionActor2D.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCubeSource.h>
#include <vtkDataArray.h>
#include <vtkFeatureEdges.h>
#include <vtkFieldData.h>
#include <vtkGeometryFilter.h>
#include <vtkGlyph3D.h>
#include <vtkIdList.h>
#include <vtkLightKit.h>
#include <vtkLookupTable.h>
#include <vtkNew.h>
#include <vtkPNGWriter.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkPolyDataMapper2D.h>
#include <vtkPolyDataNormals.h>
#include <vtkProperty.h>
#include <vtkProperty2D.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkScalarBarActor.h>
#include <vtkSmartPointer.h>
#include <vtkSphereSource.h>
#include <vtkStringArray.h>
#include <vtkTextActor.h>
#include <vtkTextProperty.h>
#include <vtkUnsignedCharArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkWarpVector.h>
#include <vtkWindowToImageFilter.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <limits>
#include <numeric>
#include <set>
#include <string>
#include <vector>

namespace {

using Vec3 = std::array<double, 3>;
using Colour = std::array<double, 3>;
template <class T> using Ptr = vtkSmartPointer<T>;

constexpr int width = 1600, height = 1200;
constexpr Colour held_colour{0.86, 0.08, 0.10}, load_colour{1.0, 0.45, 0.85}, no_group{0.85, 0.85, 0.85};
constexpr double crease = 30.0;  ///< edges with a larger angle are drawn and not shaded over [degrees]

double dot(const Vec3& a, const Vec3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Vec3 unit(const Vec3& a) {
  const double length = std::sqrt(dot(a, a));
  return {a[0] / length, a[1] / length, a[2] / length};
}
Vec3 minus(const Vec3& a, const Vec3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
Vec3 point(vtkPointSet* data, vtkIdType p) {
  Vec3 x{};
  data->GetPoint(p, x.data());
  return x;
}

/// Colours from dark blue over green to yellow, even in lightness so that they survive grey printing (viridis,
/// sampled).
vtkNew<vtkLookupTable> colours(const std::array<double, 2>& range) {
  constexpr std::array<Colour, 6> stops{{{0.267, 0.005, 0.329},
                                         {0.254, 0.265, 0.530},
                                         {0.164, 0.471, 0.558},
                                         {0.135, 0.659, 0.518},
                                         {0.478, 0.821, 0.318},
                                         {0.993, 0.906, 0.144}}};
  vtkNew<vtkLookupTable> table;
  constexpr int size = 256;
  table->SetNumberOfTableValues(size);
  for (int i = 0; i < size; ++i) {
    const double at = static_cast<double>(i) / (size - 1) * (stops.size() - 1);
    const auto left = std::min(static_cast<std::size_t>(at), stops.size() - 2);
    const double t = at - static_cast<double>(left);
    Colour rgb{};
    for (std::size_t k = 0; k < 3; ++k) rgb[k] = (1 - t) * stops[left][k] + t * stops[left + 1][k];
    table->SetTableValue(i, rgb[0], rgb[1], rgb[2]);
  }
  table->SetRange(range.data());
  return table;
}

/// As many colours as wanted, neighbours in the list far apart in hue.
Colour distinct(int i) {
  const double hue = std::fmod(0.58 + 0.618034 * i, 1.0);
  const double saturation = i % 3 == 1 ? 0.40 : 0.62, value = i % 3 == 2 ? 0.72 : 0.92;
  Colour rgb{};
  for (int k = 0; k < 3; ++k) {
    const double x = std::fmod(5.0 - 2.0 * k + 6.0 * hue, 6.0);
    rgb[static_cast<std::size_t>(k)] = value * (1.0 - saturation * std::clamp(std::min(x, 4.0 - x), 0.0, 1.0));
  }
  return rgb;
}

/// The same, behind others.
Colour pale(int i) {
  Colour rgb = distinct(i);
  for (double& c : rgb) c = 1.0 - 0.4 * (1.0 - c);
  return rgb;
}
Colour uncoloured(int) {
  return {0.87, 0.89, 0.92};
}
using Palette = Colour (*)(int);

/// Where the viewer stands: directions to the viewer and upwards, both of length one.
struct View {
  Vec3 towards{0.0, 0.0, 1.0}, up{0.0, 1.0, 0.0};
  Vec3 right() const { return cross(up, towards); }
};

/// The smallest axis-parallel box.
struct Box {
  Vec3 low{}, high{};
  explicit Box(vtkDataSet* data) {
    const double* bounds = data->GetBounds();
    for (std::size_t k = 0; k < 3; ++k) low[k] = bounds[2 * k], high[k] = bounds[2 * k + 1];
  }
  Vec3 size() const { return minus(high, low); }
};

/// A view from above and from the side with the largest faces of the box; of its four sides the one that shows most of
/// the facets marked (all points of `marks` not 0).
View oblique(vtkPolyData* surface, const std::vector<vtkDataArray*>& marks) {
  const Vec3 size = Box(surface).size();
  const Vec3 area{size[1] * size[2], size[0] * size[2], size[0] * size[1]};
  const double largest = *std::max_element(area.begin(), area.end());
  Vec3 share{};
  for (std::size_t k = 0; k < 3; ++k) share[k] = 0.35 + 0.65 * area[k] / largest;
  std::array<Vec3, 4> directions{};
  for (std::size_t side = 0; side < 4; ++side)
    directions[side] = unit({(side % 2 ? -0.6 : 0.6) * share[0], (side < 2 ? -1.0 : 1.0) * share[1], 0.75 * share[2]});
  std::array<double, 4> seen{};
  vtkNew<vtkIdList> corners;
  for (vtkIdType c = 0; c < surface->GetNumberOfCells() && !marks.empty(); ++c) {
    surface->GetCellPoints(c, corners);
    if (corners->GetNumberOfIds() < 3) continue;
    const bool marked = std::ranges::any_of(marks, [&](vtkDataArray* mark) {
      return std::all_of(corners->begin(), corners->end(), [&](vtkIdType p) { return mark->GetTuple1(p) != 0.0; });
    });
    if (!marked) continue;
    const Vec3 a = point(surface, corners->GetId(0));
    const Vec3 normal = cross(minus(point(surface, corners->GetId(1)), a), minus(point(surface, corners->GetId(2)), a));
    for (std::size_t side = 0; side < 4; ++side) seen[side] += std::max(0.0, dot(normal, directions[side]));
  }
  // Only a clear gain is worth leaving the usual side for.
  std::size_t best = 0;
  for (std::size_t side = 1; side < 4; ++side)
    if (seen[side] > 1.1 * seen[best]) best = side;
  View view{directions[best], {}};
  view.up = cross(view.towards, unit(cross({0.0, 0.0, 1.0}, view.towards)));
  return view;
}

/// Points `camera` so that all of `bodies` just fits into a viewport of that `aspect`, width over height.
void aim(vtkRenderer* renderer, const View& view, const std::vector<vtkPolyData*>& bodies, double aspect) {
  Vec3 low, high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  const std::array<Vec3, 3> axes{view.right(), view.up, view.towards};
  for (vtkPolyData* body : bodies)
    for (vtkIdType p = 0; p < body->GetNumberOfPoints(); ++p)
      for (std::size_t k = 0; k < 3; ++k) {
        const double x = dot(axes[k], point(body, p));
        low[k] = std::min(low[k], x);
        high[k] = std::max(high[k], x);
      }
  const double depth = high[2] - low[2] + std::max(high[0] - low[0], high[1] - low[1]);
  Vec3 focus{}, eye{};
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t a = 0; a < 3; ++a) focus[k] += 0.5 * (low[a] + high[a]) * axes[a][k];
    eye[k] = focus[k] + 2.0 * depth * view.towards[k];
  }
  vtkCamera* camera = renderer->GetActiveCamera();
  camera->ParallelProjectionOn();
  camera->SetFocalPoint(focus.data());
  camera->SetPosition(eye.data());
  camera->SetViewUp(view.up.data());
  camera->SetParallelScale(0.5 * 1.08 * std::max(high[1] - low[1], (high[0] - low[0]) / aspect));
  camera->SetClippingRange(0.9 * depth, 3.1 * depth);
}

void plain(vtkTextProperty* text, int size) {
  text->SetColor(0.0, 0.0, 0.0);
  text->SetFontFamilyToArial();
  text->SetFontSize(size);
  text->ItalicOff();
  text->BoldOff();
  text->ShadowOff();
}

void write(vtkRenderer* renderer, const std::string& text, double x, double y, int size) {
  vtkNew<vtkTextActor> actor;
  actor->SetInput(text.c_str());
  plain(actor->GetTextProperty(), size);
  actor->SetPosition(x, y);
  renderer->AddActor2D(actor);
}

/// A coloured square and what it stands for; x, y in pixels.
void swatch(vtkRenderer* renderer, const Colour& colour, const std::string& text, double x, double y, int size) {
  vtkNew<vtkPoints> corners;
  const double side = 0.8 * size;
  for (const auto& [a, b] : {std::pair{0.0, 0.0}, {side, 0.0}, {side, side}, {0.0, side}})
    corners->InsertNextPoint(x + a, y + b, 0.0);
  vtkNew<vtkCellArray> square;
  square->InsertNextCell({0, 1, 2, 3});
  vtkNew<vtkPolyData> shape;
  shape->SetPoints(corners);
  shape->SetPolys(square);
  vtkNew<vtkPolyDataMapper2D> mapper;
  mapper->SetInputData(shape);
  vtkNew<vtkActor2D> actor;
  actor->SetMapper(mapper);
  actor->GetProperty()->SetColor(colour[0], colour[1], colour[2]);
  renderer->AddActor2D(actor);
  write(renderer, text, x + 1.5 * size, y, size);
}

Ptr<vtkActor> add(vtkRenderer* renderer, vtkPolyData* data, const Colour& colour, double line_width = 1.0) {
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputData(data);
  mapper->ScalarVisibilityOff();
  // Lines lie on faces, which must not hide them.
  mapper->SetResolveCoincidentTopologyToPolygonOffset();
  mapper->SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -4.0);
  Ptr<vtkActor> actor = Ptr<vtkActor>::New();
  actor->SetMapper(mapper);
  actor->GetProperty()->SetColor(colour[0], colour[1], colour[2]);
  actor->GetProperty()->SetLineWidth(static_cast<float>(line_width));
  actor->GetProperty()->LightingOff();
  renderer->AddActor(actor);
  return actor;
}

/// Ends of the surface, and its creases if wanted.
Ptr<vtkPolyData> edges_of(vtkPolyData* surface, bool creases) {
  vtkNew<vtkFeatureEdges> edges;
  edges->SetInputData(surface);
  edges->BoundaryEdgesOn();
  edges->SetFeatureEdges(creases);
  edges->SetFeatureAngle(crease);
  edges->ManifoldEdgesOff();
  edges->NonManifoldEdgesOff();
  edges->ColoringOff();
  edges->Update();
  return edges->GetOutput();
}

/// The chains of lines that are connected and longer than `least`.
Ptr<vtkPolyData> long_chains(vtkPolyData* lines, double least) {
  const auto length = [&](vtkIdList* ends) {
    const Vec3 along = minus(point(lines, ends->GetId(1)), point(lines, ends->GetId(0)));
    return std::sqrt(dot(along, along));
  };
  std::vector<vtkIdType> chain(static_cast<std::size_t>(lines->GetNumberOfPoints()));  // a point that stands for it
  std::iota(chain.begin(), chain.end(), 0);
  const auto root = [&](vtkIdType p) {
    while (chain[p] != p) p = chain[p] = chain[chain[p]];
    return p;
  };
  vtkNew<vtkIdList> ends;
  for (vtkIdType c = 0; c < lines->GetNumberOfCells(); ++c) {
    lines->GetCellPoints(c, ends);
    chain[root(ends->GetId(0))] = root(ends->GetId(1));
  }
  std::vector<double> total(chain.size(), 0.0);
  for (vtkIdType c = 0; c < lines->GetNumberOfCells(); ++c) {
    lines->GetCellPoints(c, ends);
    total[root(ends->GetId(0))] += length(ends);
  }
  vtkNew<vtkCellArray> kept;
  for (vtkIdType c = 0; c < lines->GetNumberOfCells(); ++c) {
    lines->GetCellPoints(c, ends);
    if (total[root(ends->GetId(0))] >= least) kept->InsertNextCell(ends);
  }
  Ptr<vtkPolyData> out = Ptr<vtkPolyData>::New();
  out->SetPoints(lines->GetPoints());
  out->SetLines(kept);
  return out;
}

/// Edges that say something about the shape: in the plane its outline; in space ends and creases but for short bits of
/// these, and none at all if most of it is rough, as the faces of voxels are.
Ptr<vtkPolyData> shape_edges(vtkPolyData* surface) {
  const Ptr<vtkPolyData> ends = edges_of(surface, false);
  if (Box(surface).size()[2] == 0.0) return ends;
  const auto is_rough = [&](vtkPolyData* lines) {
    return static_cast<double>(lines->GetNumberOfCells()) > 0.18 * static_cast<double>(surface->GetNumberOfCells());
  };
  const Ptr<vtkPolyData> edges = edges_of(surface, true);
  if (!is_rough(edges)) return long_chains(edges, 0.15 * surface->GetLength());
  return is_rough(ends) ? Ptr<vtkPolyData>::New() : ends;
}

Ptr<vtkPolyData> with_normals(vtkPolyData* surface) {
  vtkNew<vtkPolyDataNormals> normals;
  normals->SetInputData(surface);
  normals->SetFeatureAngle(crease);
  normals->ConsistencyOff();
  normals->Update();
  return normals->GetOutput();
}

void shade(vtkActor* actor) {
  vtkProperty* property = actor->GetProperty();
  property->LightingOn();
  property->SetAmbient(0.35);
  property->SetDiffuse(0.75);
  property->SetSpecular(0.0);
}

/// The cells of `surface` with all their points marked, on the same points. In 2D its edges.
Ptr<vtkPolyData> marked_part(vtkPolyData* surface, vtkDataArray* mark, bool solid) {
  Ptr<vtkPolyData> from = solid ? Ptr<vtkPolyData>(surface) : edges_of(surface, false);
  if (!solid) mark = from->GetPointData()->GetArray(mark->GetName());
  Ptr<vtkPolyData> part = Ptr<vtkPolyData>::New();
  part->SetPoints(from->GetPoints());
  vtkNew<vtkCellArray> cells;
  vtkNew<vtkIdList> corners;
  for (vtkIdType c = 0; c < from->GetNumberOfCells(); ++c) {
    from->GetCellPoints(c, corners);
    if (std::all_of(corners->begin(), corners->end(), [&](vtkIdType p) { return mark->GetTuple1(p) != 0.0; }))
      cells->InsertNextCell(corners);
  }
  if (solid)
    part->SetPolys(cells);
  else
    part->SetLines(cells);
  return part;
}

/// Points of the cells of `part`, at most one to a cube of side `gap`.
Ptr<vtkPolyData> sparse_points(vtkPolyData* part, double gap) {
  std::set<std::array<long, 3>> taken;
  vtkNew<vtkPoints> points;
  vtkNew<vtkIdList> corners;
  for (vtkIdType c = 0; c < part->GetNumberOfCells(); ++c) {
    part->GetCellPoints(c, corners);
    for (const vtkIdType p : *corners) {
      const Vec3 x = point(part, p);
      if (taken.insert({std::lround(x[0] / gap), std::lround(x[1] / gap), std::lround(x[2] / gap)}).second)
        points->InsertNextPoint(x.data());
    }
  }
  Ptr<vtkPolyData> out = Ptr<vtkPolyData>::New();
  out->SetPoints(points);
  return out;
}

/// Lines along the part where a condition holds, in space its rim and markers all over it. Whether there is any.
bool draw_condition(vtkRenderer* renderer, vtkPolyData* surface, vtkDataArray* mark, const Colour& colour, bool solid,
                    double length, bool cubes) {
  if (!mark) return false;
  const Ptr<vtkPolyData> part = marked_part(surface, mark, solid);
  if (part->GetNumberOfCells() == 0) return false;
  if (!solid) {
    add(renderer, part, colour, 7.0);
    return true;
  }
  add(renderer, edges_of(part, false), colour, 4.0);
  vtkNew<vtkCubeSource> cube;
  vtkNew<vtkSphereSource> ball;
  const double size = length / 130.0;
  cube->SetXLength(size);
  cube->SetYLength(size);
  cube->SetZLength(size);
  ball->SetRadius(0.55 * size);
  vtkNew<vtkGlyph3D> markers;
  // Held and loaded at once: the markers must not sit in each other.
  markers->SetInputData(sparse_points(part, length / (cubes ? 30.0 : 25.0)));
  markers->SetSourceConnection(cubes ? cube->GetOutputPort() : ball->GetOutputPort());
  markers->ScalingOff();
  markers->Update();
  shade(add(renderer, markers->GetOutput(), colour));
  return true;
}

/// A window and what is in it: renderers one over the other.
class Picture {
 public:
  Picture() {
    window_->SetOffScreenRendering(1);
    window_->SetMultiSamples(8);
    window_->SetSize(width, height);
    window_->SetNumberOfLayers(3);
    margin_ = renderer({0.0, 0.0, 1.0, 1.0}, 0);
    margin_->SetBackground(1.0, 1.0, 1.0);
  }
  /// Behind everything, all of the window; for texts, in pixels.
  vtkRenderer* margin() const { return margin_; }

  Ptr<vtkRenderer> renderer(const std::array<double, 4>& viewport, int layer) {
    Ptr<vtkRenderer> out = Ptr<vtkRenderer>::New();
    out->SetViewport(viewport.data());
    out->SetLayer(layer);
    window_->AddRenderer(out);
    return out;
  }

  /// Little axes as seen in `view`, in the lower right corner.
  void add_axes(const View& view, bool solid) {
    const Ptr<vtkRenderer> corner = renderer({0.865, 0.0, 0.985, 0.16}, 2);
    vtkNew<vtkAxesActor> axes;
    for (vtkCaptionActor2D* caption :
         {axes->GetXAxisCaptionActor2D(), axes->GetYAxisCaptionActor2D(), axes->GetZAxisCaptionActor2D()}) {
      plain(caption->GetCaptionTextProperty(), 26);
      caption->GetTextActor()->SetTextScaleModeToNone();
    }
    axes->SetXAxisLabelText("x");
    axes->SetYAxisLabelText("y");
    axes->SetZAxisLabelText(solid ? "z" : "");
    axes->SetTotalLength(1.0, 1.0, solid ? 1.0 : 1e-3);
    for (vtkProperty* property :
         {axes->GetXAxisShaftProperty(), axes->GetXAxisTipProperty(), axes->GetYAxisShaftProperty(),
          axes->GetYAxisTipProperty(), axes->GetZAxisShaftProperty(), axes->GetZAxisTipProperty()}) {
      property->SetColor(0.25, 0.25, 0.25);
      property->SetLineWidth(3.0);
      property->LightingOff();
    }
    corner->AddActor(axes);
    vtkCamera* camera = corner->GetActiveCamera();
    const Vec3 focus = solid ? Vec3{0.25, 0.25, 0.25} : Vec3{0.5, 0.5, 0.0};
    Vec3 eye{};
    for (std::size_t k = 0; k < 3; ++k) eye[k] = focus[k] + 5.0 * view.towards[k];
    camera->ParallelProjectionOn();
    camera->SetFocalPoint(focus.data());
    camera->SetPosition(eye.data());
    camera->SetViewUp(view.up.data());
    camera->SetParallelScale(solid ? 1.5 : 0.95);
    camera->SetClippingRange(0.1, 20.0);
  }

  void save(const char* file) {
    window_->Render();
    vtkNew<vtkWindowToImageFilter> image;
    image->SetInput(window_);
    image->ReadFrontBufferOff();
    vtkNew<vtkPNGWriter> writer;
    writer->SetFileName(file);
    writer->SetInputConnection(image->GetOutputPort());
    writer->Write();
  }

 private:
  vtkNew<vtkRenderWindow> window_;
  Ptr<vtkRenderer> margin_;
};

void add_lights(vtkRenderer* renderer) {
  vtkNew<vtkLightKit> lights;
  lights->SetKeyLightIntensity(0.85);
  lights->SetKeyToFillRatio(2.2);
  lights->AddLightsToRenderer(renderer);
}

bool is_solid(vtkUnstructuredGrid* grid) {
  for (vtkIdType c = 0; c < grid->GetNumberOfCells(); ++c)
    if (grid->GetCell(c)->GetCellDimension() == 3) return true;
  return false;
}

std::string dimensions(vtkDataSet* data, bool solid) {
  const Vec3 size = Box(data).size();
  return solid ? fmt::format("{:.4g} x {:.4g} x {:.4g}", size[0], size[1], size[2])
               : fmt::format("{:.4g} x {:.4g}", size[0], size[1]);
}

/// What the colours span: all values, unless a few (one in 200) stand out of the others by half.
std::array<double, 2> colour_range(vtkDataArray* values) {
  std::vector<double> sorted;
  for (vtkIdType i = 0; i < values->GetNumberOfTuples(); ++i)
    if (std::isfinite(values->GetTuple1(i))) sorted.push_back(values->GetTuple1(i));
  if (sorted.empty()) return {0.0, 1.0};
  std::sort(sorted.begin(), sorted.end());
  const double high = sorted[static_cast<std::size_t>(0.995 * static_cast<double>(sorted.size() - 1))];
  std::array<double, 2> range{sorted.front(), sorted.back() > 1.5 * high && high > 0.0 ? high : sorted.back()};
  // A uniform field would have a scale of round-off.
  if (range[1] - range[0] <= 1e-6 * std::abs(range[1])) range = {0.0, range[1] > 0.0 ? 1.25 * range[1] : 1.0};
  return range;
}

Ptr<vtkUnstructuredGrid> read(const char* file) {
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName(file);
  reader->Update();
  Ptr<vtkUnstructuredGrid> grid = reader->GetOutput();
  if (grid->GetNumberOfCells() == 0) throw std::runtime_error(fmt::format("{} holds no mesh", file));
  return grid;
}

void draw_fields(const char* file, const char* picture_file) {
  const Ptr<vtkUnstructuredGrid> grid = read(file);
  vtkPointData* data = grid->GetPointData();
  vtkDataArray* displacement = data->GetArray("displacement");
  vtkDataArray* mises = data->GetArray("von_mises");
  if (!displacement || !mises) throw std::runtime_error(fmt::format("{} holds no fields", file));
  data->SetActiveVectors("displacement");
  data->SetActiveScalars("von_mises");
  const bool solid = is_solid(grid);

  vtkNew<vtkGeometryFilter> skin;
  skin->SetInputData(grid);
  skin->Update();
  const Ptr<vtkPolyData> undeformed = skin->GetOutput();
  // Deformations are drawn at a fifteenth of the body's size, whatever they are.
  const double largest = displacement->GetMaxNorm();
  const double scale = largest > 0.0 ? grid->GetLength() / (15.0 * largest) : 0.0;
  vtkNew<vtkWarpVector> warp;
  warp->SetInputData(undeformed);
  warp->SetScaleFactor(scale);
  warp->Update();
  const Ptr<vtkPolyData> deformed = vtkPolyData::SafeDownCast(warp->GetOutput());

  Picture picture;
  const std::array<double, 4> viewport{0.01, 0.06, 0.85, 0.9};
  const Ptr<vtkRenderer> behind = picture.renderer(viewport, 1), front = picture.renderer(viewport, 2);
  vtkPointData* on_skin = deformed->GetPointData();
  vtkDataArray* restrained = on_skin->GetArray("restrained");
  vtkDataArray* loaded = on_skin->GetArray("loaded");
  std::vector<vtkDataArray*> marks;
  for (vtkDataArray* mark : {restrained, loaded})
    if (mark) marks.push_back(mark);
  const View view = solid ? oblique(undeformed, marks) : View{};
  aim(front, view, {undeformed, deformed},
      width * (viewport[2] - viewport[0]) / (height * (viewport[3] - viewport[1])));
  behind->SetActiveCamera(front->GetActiveCamera());

  // The undeformed body: a pale shadow that the deformed one always covers.
  if (solid) add(behind, undeformed, {0.92, 0.92, 0.92});
  const Ptr<vtkPolyData> outline = shape_edges(undeformed);
  // Of pores in the plane it would show through those of the deformed body.
  add(behind, solid ? outline : long_chains(outline, undeformed->GetLength()), {0.68, 0.68, 0.68}, 2.0);

  const auto table = colours(colour_range(mises));
  const Ptr<vtkPolyData> smooth = solid ? with_normals(deformed) : deformed;
  const Ptr<vtkActor> body = add(front, smooth, {1.0, 1.0, 1.0});
  auto* mapper = vtkPolyDataMapper::SafeDownCast(body->GetMapper());
  mapper->ScalarVisibilityOn();
  mapper->SetLookupTable(table);
  mapper->UseLookupTableScalarRangeOn();
  mapper->InterpolateScalarsBeforeMappingOn();
  if (solid) {
    shade(body);
    add_lights(front);
  }
  add(front, shape_edges(deformed), {0.1, 0.1, 0.1}, solid ? 1.5 : 2.0);
  const double length = grid->GetLength();
  const bool shows_held = draw_condition(front, deformed, restrained, held_colour, solid, length, true);
  const bool shows_load = draw_condition(front, deformed, loaded, load_colour, solid, length, false);

  vtkNew<vtkScalarBarActor> bar;
  bar->SetLookupTable(table);
  bar->SetNumberOfLabels(6);
  bar->SetLabelFormat("%-#.3g");
  bar->UnconstrainedFontSizeOn();
  bar->GetPositionCoordinate()->SetValue(0.87, 0.2);
  bar->SetWidth(0.1);
  bar->SetHeight(0.66);
  bar->SetBarRatio(0.3);
  plain(bar->GetLabelTextProperty(), 26);
  picture.margin()->AddActor2D(bar);
  write(picture.margin(), fmt::format("von Mises stress, displacements drawn x {:.3g}", scale), 50, 1140, 34);
  std::string facts = fmt::format("body {}, largest displacement {:.4g}", dimensions(grid, solid), largest);
  if (const double peak = mises->GetFiniteRange()[1]; peak > table->GetRange()[1])
    facts += fmt::format(", largest stress {:.4g}, beyond the scale", peak);
  write(picture.margin(), facts, 50, 1098, 26);
  double x = 50.0;
  if (shows_held) swatch(picture.margin(), held_colour, "displacement prescribed", x, 24, 26), x += 420.0;
  if (shows_load) swatch(picture.margin(), load_colour, "loaded", x, 24, 26), x += 200.0;
  if (largest > 0.0) swatch(picture.margin(), {0.85, 0.85, 0.85}, "undeformed", x, 24, 26);
  picture.add_axes(view, solid);
  picture.save(picture_file);
}

std::vector<std::string> names(vtkDataSet* data, const char* array) {
  std::vector<std::string> out;
  if (auto* list = vtkStringArray::SafeDownCast(data->GetFieldData()->GetAbstractArray(array)))
    for (vtkIdType i = 0; i < list->GetNumberOfValues(); ++i) out.push_back(list->GetValue(i));
  return out;
}

/// The cells of that dimension, coloured by a cell array; -1 is grey.
Ptr<vtkPolyData> coloured(vtkUnstructuredGrid* grid, int dimension, const char* array, Palette palette) {
  Ptr<vtkPolyData> out = Ptr<vtkPolyData>::New();
  out->SetPoints(grid->GetPoints());
  vtkNew<vtkCellArray> cells;
  vtkNew<vtkUnsignedCharArray> rgb;
  rgb->SetNumberOfComponents(3);
  vtkDataArray* values = grid->GetCellData()->GetArray(array);
  vtkNew<vtkIdList> corners;
  for (vtkIdType c = 0; c < grid->GetNumberOfCells(); ++c) {
    if (grid->GetCell(c)->GetCellDimension() != dimension) continue;
    grid->GetCellPoints(c, corners);
    cells->InsertNextCell(corners);
    const int value = values ? static_cast<int>(values->GetTuple1(c)) : -1;
    const Colour colour = value < 0 ? no_group : palette(value);
    rgb->InsertNextTuple3(255 * colour[0], 255 * colour[1], 255 * colour[2]);
  }
  if (dimension == 2)
    out->SetPolys(cells);
  else
    out->SetLines(cells);
  out->GetCellData()->SetScalars(rgb);
  return out;
}

/// Names with their colours in columns from (x, y) downwards, as many as there is room for.
void legend(vtkRenderer* margin, const std::string& title, const std::vector<std::string>& entries, Palette palette,
            double x, double y, double right, double bottom) {
  constexpr int size = 22;
  constexpr double line = 1.4 * size;
  write(margin, title, x, y, size + 2);
  std::size_t longest = 6;
  for (const std::string& entry : entries) longest = std::max(longest, std::min<std::size_t>(entry.size(), 24));
  const double column = size * (2.2 + 0.52 * static_cast<double>(longest));
  const auto rows = static_cast<std::size_t>((y - bottom) / line);
  const std::size_t columns = std::max<std::size_t>(1, static_cast<std::size_t>((right - x) / column));
  const std::size_t room = rows * columns, shown = entries.size() <= room ? entries.size() : room - 1;
  for (std::size_t i = 0; i <= shown && i < entries.size(); ++i) {
    const double at_x = x + column * static_cast<double>(i / rows), at_y = y - line * static_cast<double>(i % rows + 1);
    const std::string& name = entries[i];
    if (i < shown)
      swatch(margin, palette(static_cast<int>(i)), name.size() > 24 ? name.substr(0, 23) + "..." : name, at_x, at_y,
             size);
    else
      write(margin, fmt::format("and {} more", entries.size() - shown), at_x, at_y, size);
  }
}

void draw_geometry(const char* file, const char* picture_file) {
  const Ptr<vtkUnstructuredGrid> grid = read(file);
  const bool solid = Box(grid).size()[2] > 0.0;  // surfaces are all there is of solids
  const std::vector<std::string> regions = names(grid, "region_names"), groups = names(grid, "group_names");
  // In the plane a face and its edges show both; in space each takes a picture of its own.
  std::vector<const char*> panels{"region"};
  if (solid && !groups.empty()) {
    if (regions.size() > 1)
      panels.push_back("group");
    else
      panels = {"group"};
  }
  Picture picture;
  View view;
  const double top = 0.92, bottom = solid || !groups.empty() || regions.size() > 1 ? 0.26 : 0.04;
  for (std::size_t i = 0; i < panels.size(); ++i) {
    const double panel = 1.0 / static_cast<double>(panels.size()), left = panel * static_cast<double>(i);
    const std::array<double, 4> viewport{left + 0.01, bottom, left + panel - 0.01, top};
    const Ptr<vtkRenderer> renderer = picture.renderer(viewport, 1);
    const Palette palette = solid ? distinct : regions.size() > 1 ? pale : uncoloured;
    const Ptr<vtkPolyData> surface = coloured(grid, 2, panels[i], palette);
    view = solid ? oblique(surface, {}) : View{};
    aim(renderer, view, {surface}, width * (viewport[2] - viewport[0]) / (height * (top - bottom)));
    const Ptr<vtkPolyData> smooth = solid ? with_normals(surface) : surface;
    const Ptr<vtkActor> actor = add(renderer, smooth, {1.0, 1.0, 1.0});
    actor->GetMapper()->ScalarVisibilityOn();
    if (solid) {
      shade(actor);
      add_lights(renderer);
    }
    const bool pixels = surface->GetMaxCellSize() == 4;
    if (surface->GetNumberOfCells() < 60000 && !pixels) {
      actor->GetProperty()->EdgeVisibilityOn();
      actor->GetProperty()->SetEdgeColor(0.45, 0.45, 0.45);
      actor->GetProperty()->SetLineWidth(0.5F);
    }
    if (solid)
      add(renderer, shape_edges(surface), {0.1, 0.1, 0.1}, 2.0);
    else {
      const Ptr<vtkActor> lines = add(renderer, coloured(grid, 1, "group", distinct), {1.0, 1.0, 1.0}, 7.0);
      lines->GetMapper()->ScalarVisibilityOn();
    }
    const bool is_region = std::string(panels[i]) == "region";
    const auto& entries = is_region ? regions : groups;
    const std::string title = is_region ? "regions" : "boundary";
    const double right = width * (left + panel) - 30.0 - (left + panel > 0.99 ? 0.13 * width : 0.0);
    if (solid || regions.size() > 1)
      legend(picture.margin(), title, entries, palette, 50.0 + width * left, height * bottom - 30.0, right, 10.0);
    if (!solid && !groups.empty())
      legend(picture.margin(), "boundary", groups, distinct, regions.size() > 1 ? 0.5 * width : 50.0,
             height * bottom - 30.0, 0.86 * width, 10.0);
  }
  write(picture.margin(), fmt::format("body {}", dimensions(grid, solid)), 50, 1140, 32);
  picture.add_axes(view, solid);
  picture.save(picture_file);
}

using Draw = void (*)(const char*, const char*);

/// Whether the picture could be drawn on the X display there is, tried in a process of its own: VTK aborts on a dead
/// one.
bool drawn_on_display(Draw draw, const char* data, const char* picture) {
  const char* display = std::getenv("DISPLAY");
  if (!display || !*display) return false;
  const pid_t child = fork();
  if (child == 0) {
    alarm(60);  // a display that hangs must not hang the analysis
    try {
      draw(data, picture);
      _exit(0);
    } catch (const std::exception& error) {
      fmt::print(stderr, "{}\n", error.what());
    }
    _exit(1);
  }
  int status = 0;
  return child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

}  // namespace

int main(int argc, char** argv) try {
  const bool geometry = argc == 4 && std::string(argv[1]) == "--geometry";
  if (argc != 3 && !geometry) throw std::runtime_error("usage: efree-picture [--geometry] DATA.vtu PICTURE.png");
  const Draw draw = geometry ? draw_geometry : draw_fields;
  const char* data = argv[argc - 2];
  const char* picture = argv[argc - 1];
  if (drawn_on_display(draw, data, picture)) return 0;
  alarm(60);
  const efree::VirtualDisplay display;
  if (!display.started())
    throw std::runtime_error("there is no X display, and no Xvfb to start (Debian: apt install xvfb)");
  draw(data, picture);
  return 0;
} catch (const std::exception& error) {
  fmt::print(stderr, "{}\n", error.what());
  return 1;
}
