// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/pictures/internal/canvas.hpp"

#include "efree/core/error.hpp"
#include "efree/io/files/internal/cannot_write.hpp"

#include <fmt/format.h>
#include <vtkFreeTypeTools.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGWriter.h>
#include <vtkStdString.h>
#include <vtkTextProperty.h>
#include <map>

namespace efree::internal {
namespace {

/// UTF-8 by letters of ASCII.
std::string in_ascii(const std::string& words) {
  static const std::map<std::string, std::string> letters{
      {"\u00b5", "u"},  {"\u03bc", "u"},       {"\u00b0", "deg"}, {"\u00b2", "^2"},      {"\u00b3", "^3"},
      {"\u00b7", "*"},  {"\u22c5", "*"},       {"\u00d7", "x"},   {"\u2013", "-"},       {"\u2014", "-"},
      {"\u2212", "-"},  {"\u2030", "per mil"}, {"\u00c4", "Ae"},  {"\u00d6", "Oe"},      {"\u00dc", "Ue"},
      {"\u00e4", "ae"}, {"\u00f6", "oe"},      {"\u00fc", "ue"},  {"\u00df", "ss"},      {"\u00d8", "D"},
      {"\u2300", "D"},  {"\u03c3", "sigma"},   {"\u03c4", "tau"}, {"\u03b5", "epsilon"}, {"\u00e9", "e"},
      {"\u00e8", "e"},  {"\u00ea", "e"},       {"\u00e1", "a"},   {"\u00e0", "a"},       {"\u00e2", "a"},
      {"\u00ed", "i"},  {"\u00f3", "o"},       {"\u00fa", "u"},   {"\u00f1", "n"},       {"\u00e7", "c"},
      {"\u00e5", "a"},  {"\u00f8", "o"},       {"\u207b", "^-"},  {"\u00b9", "1"}};
  std::string out;
  for (std::size_t i = 0; i < words.size();) {
    const auto first = static_cast<unsigned char>(words[i]);
    if (first < 0x80) {
      out += first < 0x20 || first == 0x7f ? ' ' : words[i];
      ++i;
      continue;
    }
    std::size_t length = 1;
    while (i + length < words.size() && (static_cast<unsigned char>(words[i + length]) & 0xc0) == 0x80) ++length;
    const auto found = letters.find(words.substr(i, length));
    out += found == letters.end() ? "?" : found->second;
    i += length;
  }
  return out;
}

}  // namespace

Canvas::Canvas() : colours_(static_cast<std::size_t>(rows) * width, {255, 255, 255}), depths_(colours_.size(), 0.0F) {}

void Canvas::triangle(const std::array<Position, 3>& corners, const Colour& colour) {
  const Pixel ink = pixel(colour);
  triangle<0>({Corner<0>{corners[0], {}}, {corners[1], {}}, {corners[2], {}}}, [&](const auto&) { return ink; });
}

void Canvas::rectangle(double left, double bottom, double right, double top, const Colour& colour) {
  const Position a{left, bottom, 0.0}, b{right, bottom, 0.0}, c{right, top, 0.0}, d{left, top, 0.0};
  triangle({a, b, c}, colour);
  triangle({a, c, d}, colour);
}

void Canvas::line(const Position& from, const Position& to, double line_width, const Colour& colour, double lift) {
  const Pixel ink = pixel(colour);
  const double half = 0.5 * line_width;
  const Position along = to - from;
  const double squared_length = along.head<2>().squaredNorm();
  const auto [first, last] = row_range(std::min(from.y(), to.y()) - half, std::max(from.y(), to.y()) + half);
  for (int row = first; row <= last; ++row) {
    const double y = height_of(row);
    // The stretch of the line that comes as near to this row as half its width.
    double enter = 0.0, leave = 1.0;
    if (along.y() != 0.0) {
      const double one = (y - half - from.y()) / along.y(), other = (y + half - from.y()) / along.y();
      enter = std::clamp(std::min(one, other), 0.0, 1.0);
      leave = std::clamp(std::max(one, other), 0.0, 1.0);
    }
    const double at = from.x() + enter * along.x(), until = from.x() + leave * along.x();
    const auto [begin, end] = column_range(row, std::min(at, until) - half, std::max(at, until) + half);
    for (int column = begin; column <= end; ++column) {
      const Eigen::Vector2d here = Eigen::Vector2d{place_of(row, column), y} - from.head<2>();
      const double t = squared_length > 0.0 ? std::clamp(here.dot(along.head<2>()) / squared_length, 0.0, 1.0) : 0.0;
      if ((here - t * along.head<2>()).squaredNorm() > half * half) continue;
      const float here_depth = depth(from.z() + t * along.z() + lift);
      float& nearest = depths_[sample(row, column)];
      if (here_depth < nearest) continue;
      nearest = here_depth;
      colours_[sample(row, column)] = ink;
    }
  }
}

void Canvas::text(const std::string& words, double x, double y, int size) {
  texts_.push_back({in_ascii(words), x, y, size});
}

void Canvas::fitted_text(std::string words, double x, double y, int size, double widest) {
  words = in_ascii(words);
  const auto fitting = static_cast<int>(widest / (letter_width * static_cast<double>(words.size()) + 1e-9));
  constexpr int smallest = 18;
  const int fitted = std::clamp(fitting, std::min(smallest, size), size);
  const auto letters = static_cast<std::size_t>(widest / (letter_width * fitted));
  if (words.size() > letters) words = words.substr(0, letters - std::min<std::size_t>(letters, 3)) + "...";
  texts_.push_back({std::move(words), x, y, fitted});
}

void Canvas::save(const std::filesystem::path& file) const {
  vtkNew<vtkImageData> image;
  image->SetDimensions(width, height, 1);
  image->AllocateScalars(VTK_UNSIGNED_CHAR, 3);
  auto* out = static_cast<std::uint8_t*>(image->GetScalarPointer());
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (std::size_t k = 0; k < 3; ++k) {
        int sum = rows_per_pixel / 2;
        for (int s = 0; s < rows_per_pixel; ++s) sum += colours_[sample(rows_per_pixel * y + s, x)][k];
        *out++ = static_cast<std::uint8_t>(sum / rows_per_pixel);
      }

  vtkNew<vtkTextProperty> style;
  style->SetFontFamilyToArial();
  style->SetColor(0.0, 0.0, 0.0);
  vtkNew<vtkImageData> letters;
  for (const Text& text : texts_) {
    style->SetFontSize(text.size);
    std::array<int, 2> box{};
    constexpr int points_per_inch = 72;  // sizes are in pixels
    if (!vtkFreeTypeTools::GetInstance()->RenderString(style, vtkStdString(text.words), points_per_inch, letters,
                                                       box.data()))
      throw InputError(fmt::format("cannot write \"{}\" into a picture", text.words));
    const int left = static_cast<int>(std::lround(text.x)), bottom = static_cast<int>(std::lround(text.y));
    for (int y = std::max(0, -bottom); y < std::min(box[1], height - bottom); ++y)
      for (int x = std::max(0, -left); x < std::min(box[0], width - left); ++x) {
        const int cover = static_cast<const std::uint8_t*>(letters->GetScalarPointer(x, y, 0))[3];
        auto* under = static_cast<std::uint8_t*>(image->GetScalarPointer(left + x, bottom + y, 0));
        for (int k = 0; k < 3; ++k) under[k] = static_cast<std::uint8_t>(under[k] * (255 - cover) / 255);
      }
  }

  vtkNew<vtkPNGWriter> writer;
  writer->SetFileName(file.c_str());
  writer->SetInputData(image);
  writer->SetCompressionLevel(2);  // a third of the default's time for a tenth more bytes
  writer->Write();
  if (writer->GetErrorCode() != 0) internal::cannot_write(file);
}

}  // namespace efree::internal
