// SPDX-License-Identifier: GPL-3.0-or-later
// efree-picture FIELDS.vtu PICTURE.png: von Mises stress on the deformed body, the undeformed outline behind it.
// Uses the X display there is, or an Xvfb of its own where it is missing or dead. Exit status 1 with a message if there
// is neither.
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vtkActor.h>
#include <vtkCamera.h>
#include <vtkDataArray.h>
#include <vtkFeatureEdges.h>
#include <vtkGeometryFilter.h>
#include <vtkLookupTable.h>
#include <vtkNew.h>
#include <vtkPNGWriter.h>
#include <vtkPointData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkScalarBarActor.h>
#include <vtkTextActor.h>
#include <vtkTextProperty.h>
#include <vtkUnstructuredGrid.h>
#include <vtkWarpVector.h>
#include <vtkWindowToImageFilter.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <exception>

namespace {

/// An X server without a screen, ended with this object.
class VirtualDisplay {
 public:
  VirtualDisplay() {
    std::array<int, 2> channel{};
    if (pipe(channel.data()) != 0) return;
    server_ = fork();
    if (server_ == 0) {
      close(channel[0]);
      const std::string number = std::to_string(channel[1]);
      execlp("Xvfb", "Xvfb", "-displayfd", number.c_str(), "-screen", "0", "1600x1200x24", "-nolisten", "tcp", nullptr);
      _exit(127);
    }
    close(channel[1]);
    std::array<char, 32> name{':'};
    ssize_t length = 1;
    for (ssize_t got; length < 31 && (got = read(channel[0], name.data() + length, 1)) == 1 && name[length] != '\n';
         ++length) {
    }
    close(channel[0]);
    name[static_cast<std::size_t>(length)] = '\0';
    started_ = length > 1;
    if (started_) setenv("DISPLAY", name.data(), 1);
  }
  ~VirtualDisplay() {
    if (server_ <= 0) return;
    kill(server_, SIGTERM);
    waitpid(server_, nullptr, 0);
  }
  VirtualDisplay(const VirtualDisplay&) = delete;
  VirtualDisplay& operator=(const VirtualDisplay&) = delete;
  bool started() const { return started_; }

 private:
  pid_t server_ = -1;
  bool started_ = false;
};

/// Colours from dark blue over green to yellow, even in lightness so that they survive grey printing (viridis,
/// sampled).
vtkNew<vtkLookupTable> colours(const double* range) {
  constexpr std::array<std::array<double, 3>, 6> stops{{{0.267, 0.005, 0.329},
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
    std::array<double, 3> rgb{};
    for (std::size_t k = 0; k < 3; ++k) rgb[k] = (1 - t) * stops[left][k] + t * stops[left + 1][k];
    table->SetTableValue(i, rgb[0], rgb[1], rgb[2]);
  }
  table->SetRange(range);
  return table;
}

void add_outline(vtkRenderer* renderer, vtkAlgorithmOutput* surface, double grey, double width) {
  vtkNew<vtkFeatureEdges> edges;
  edges->SetInputConnection(surface);
  edges->FeatureEdgesOff();
  edges->ManifoldEdgesOff();
  edges->NonManifoldEdgesOff();
  edges->ColoringOff();
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputConnection(edges->GetOutputPort());
  mapper->ScalarVisibilityOff();
  vtkNew<vtkActor> actor;
  actor->SetMapper(mapper);
  actor->GetProperty()->SetColor(grey, grey, grey);
  actor->GetProperty()->SetLineWidth(static_cast<float>(width));
  actor->GetProperty()->LightingOff();
  renderer->AddActor(actor);
}

/// Shows all that is in `renderer`, with a little room around it; `aspect` is width over height of its viewport.
void fit(vtkRenderer* renderer, double aspect) {
  std::array<double, 6> bounds{};
  renderer->ComputeVisiblePropBounds(bounds.data());
  const double width = bounds[1] - bounds[0], height = bounds[3] - bounds[2];
  vtkCamera* camera = renderer->GetActiveCamera();
  camera->ParallelProjectionOn();
  renderer->ResetCamera();
  camera->SetParallelScale(0.5 * 1.1 * std::max(height, width / aspect));
}

void plain(vtkTextProperty* text, int size) {
  text->SetColor(0.0, 0.0, 0.0);
  text->SetFontFamilyToArial();
  text->SetFontSize(size);
  text->ItalicOff();
  text->BoldOff();
  text->ShadowOff();
}

void draw(const char* fields, const char* picture) {
  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName(fields);
  reader->Update();
  vtkUnstructuredGrid* grid = reader->GetOutput();
  vtkPointData* data = grid->GetPointData();
  data->SetActiveVectors("displacement");
  data->SetActiveScalars("von_mises");
  vtkDataArray* displacement = data->GetArray("displacement");
  vtkDataArray* mises = data->GetArray("von_mises");
  if (!displacement || !mises) throw std::runtime_error(fmt::format("{} holds no fields", fields));

  // Deformations are drawn at a fifteenth of the body's size, whatever they are.
  const double largest = displacement->GetMaxNorm();
  const double scale = largest > 0.0 ? grid->GetLength() / (15.0 * largest) : 0.0;
  vtkNew<vtkWarpVector> warp;
  warp->SetInputConnection(reader->GetOutputPort());
  warp->SetScaleFactor(scale);
  vtkNew<vtkGeometryFilter> deformed, undeformed;
  deformed->SetInputConnection(warp->GetOutputPort());
  undeformed->SetInputConnection(reader->GetOutputPort());

  const auto table = colours(mises->GetFiniteRange());
  vtkNew<vtkPolyDataMapper> mapper;
  mapper->SetInputConnection(deformed->GetOutputPort());
  mapper->SetLookupTable(table);
  mapper->UseLookupTableScalarRangeOn();
  mapper->InterpolateScalarsBeforeMappingOn();
  vtkNew<vtkActor> body;
  body->SetMapper(mapper);
  body->GetProperty()->LightingOff();

  vtkNew<vtkRenderer> renderer;
  renderer->SetBackground(1.0, 1.0, 1.0);
  renderer->SetViewport(0.0, 0.0, 0.84, 0.92);
  add_outline(renderer, undeformed->GetOutputPort(), 0.6, 2.0);
  renderer->AddActor(body);
  add_outline(renderer, deformed->GetOutputPort(), 0.1, 2.0);
  fit(renderer, 1600.0 * 0.84 / (1200.0 * 0.92));

  vtkNew<vtkRenderer> margin;
  margin->SetBackground(1.0, 1.0, 1.0);
  margin->SetViewport(0.0, 0.0, 1.0, 1.0);
  vtkNew<vtkScalarBarActor> bar;
  bar->SetLookupTable(table);
  bar->SetNumberOfLabels(6);
  bar->SetLabelFormat("%-#.3g");
  bar->UnconstrainedFontSizeOn();
  bar->GetPositionCoordinate()->SetValue(0.86, 0.12);
  bar->SetWidth(0.1);
  bar->SetHeight(0.7);
  bar->SetBarRatio(0.3);
  plain(bar->GetLabelTextProperty(), 26);
  vtkNew<vtkTextActor> title;
  title->SetInput(fmt::format("von Mises stress, displacements drawn x {:.3g}", scale).c_str());
  plain(title->GetTextProperty(), 34);
  title->SetPosition(60, 1120);
  margin->AddActor2D(bar);
  margin->AddActor2D(title);

  vtkNew<vtkRenderWindow> window;
  window->SetOffScreenRendering(1);
  window->SetMultiSamples(8);
  window->SetSize(1600, 1200);
  window->AddRenderer(margin);
  window->AddRenderer(renderer);
  window->Render();
  vtkNew<vtkWindowToImageFilter> image;
  image->SetInput(window);
  image->ReadFrontBufferOff();
  vtkNew<vtkPNGWriter> writer;
  writer->SetFileName(picture);
  writer->SetInputConnection(image->GetOutputPort());
  writer->Write();
}

/// Whether the picture could be drawn on the X display there is, tried in a process of its own: VTK aborts on a dead
/// one.
bool drawn_on_display(const char* fields, const char* picture) {
  const char* display = std::getenv("DISPLAY");
  if (!display || !*display) return false;
  const pid_t child = fork();
  if (child == 0) {
    alarm(60);  // a display that hangs must not hang the analysis
    try {
      draw(fields, picture);
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
  if (argc != 3) throw std::runtime_error("usage: efree-picture FIELDS.vtu PICTURE.png");
  if (drawn_on_display(argv[1], argv[2])) return 0;
  alarm(60);
  const VirtualDisplay virtual_display;
  if (!virtual_display.started()) throw std::runtime_error("no X display and no Xvfb");
  draw(argv[1], argv[2]);
  return 0;
} catch (const std::exception& error) {
  fmt::print(stderr, "{}\n", error.what());
  return 1;
}
