// SPDX-License-Identifier: GPL-3.0-or-later
/// Pictures of frames as a film.
#pragma once

#include <filesystem>
#include <string>

namespace efree::internal {

/// Joins SERIES_0000.png, SERIES_0001.png, ... of a folder, where SERIES is "frame" or "frame_NAME", by ffmpeg into
/// animation.FORMAT or animation_NAME.FORMAT; the format is "webm" (VP9), "mp4" (H.264) or "gif". It lasts five seconds
/// if that means 5 to 30 frames a second. Returns why there is none, or an empty string.
std::string animate(const std::filesystem::path& folder, const std::string& series, const std::string& format);

}  // namespace efree::internal
