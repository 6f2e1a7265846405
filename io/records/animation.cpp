// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/records/internal/animation.hpp"

#include "efree/io/files/child_process.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <vector>

namespace efree::internal {
namespace fs = std::filesystem;
namespace {

std::vector<std::string> encoder_of(const std::string& format) {
  if (format == "gif") return {"-vf", "scale=800:-1:flags=area,split[a][b];[a]palettegen[p];[b][p]paletteuse"};
  if (format == "mp4") return {"-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20"};
  return {"-c:v", "libvpx-vp9", "-pix_fmt", "yuv420p", "-b:v", "0", "-crf", "24", "-row-mt", "1", "-cpu-used", "4"};
}

}  // namespace

std::string animate(const fs::path& folder, const std::string& series, const std::string& format) {
  // A run that was resumed with other pictures has them from some frame on.
  constexpr int most = 100000;
  const auto is_there = [&](int frame) { return fs::exists(folder / fmt::format("{}_{:04}.png", series, frame)); };
  int first = 0, frames = 0;
  while (first < most && !is_there(first)) ++first;
  while (is_there(first + frames)) ++frames;
  if (frames == 0) return fmt::format("no animation of {}: it has no pictures", series);
  const std::string file = fmt::format("animation{}.{}", series.substr(std::string("frame").size()), format);
  std::vector<std::string> command{"ffmpeg",
                                   "-nostdin",
                                   "-loglevel",
                                   "error",
                                   "-y",
                                   "-framerate",
                                   std::to_string(std::clamp(frames / 5, 5, 30)),
                                   "-i",
                                   series + "_%04d.png"};
  for (const std::string& option : encoder_of(format)) command.push_back(option);
  command.insert(command.end(), {"-bitexact", file});
  std::string output;
  const int status = run_program(folder, command, &output);
  if (status == 0) return "";
  std::error_code error;
  fs::remove(folder / file, error);
  if (status == 127)
    return "no animation: ffmpeg is not installed (Debian: apt install ffmpeg); the pictures are there";
  return fmt::format("no animation: ffmpeg failed: {}", output.substr(0, output.find('\n')));
}

}  // namespace efree::internal
