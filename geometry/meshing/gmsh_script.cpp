// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/geometry/meshing/internal/gmsh_script.hpp"

#include "efree/core/error.hpp"
#include "efree/core/internal/lower_case.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

namespace efree::internal {
namespace {

namespace fs = std::filesystem;

/// Commands and what they do (gmsh 4 reference manual, "Gmsh scripting language"; old names among them).
constexpr std::array<std::pair<std::string_view, std::string_view>, 12> commands{{
    {"SystemCall", "runs a program"},
    {"System", "runs a program"},
    {"NonBlockingSystemCall", "runs a program"},
    {"OnelabRun", "runs a program"},
    {"OnelabAction", "runs a program"},
    {"Save", "writes a file"},
    {"CreateDir", "makes a folder"},
    {"Plugin", "runs a plugin"},
    {"SendToServer", "sends to another program"},
    {"Exit", "ends the program"},
    {"Abort", "ends reading"},
    {"Sleep", "waits"},
}};

struct Token {
  enum class Kind { word, text, sign, none } kind;
  std::string_view text;  ///< of a string what stands between its quotes
  int line;
};

[[noreturn]] void refuse(const fs::path& file, const Token& token, std::string_view what) {
  throw InputError(
      fmt::format("{}, line {}: {} {}; a script that does more than describe geometry is run with --trust only (in C++ "
                  "GmshOptions::trust)",
                  file.string(), token.line, token.text, what));
}

/// The tokens of a script, comments and numbers left out; parted as gmsh's lexer does, and what it might part in
/// another way is refused.
class Tokens {
 public:
  Tokens(const fs::path& file, std::string_view script) : file_(file), rest_(script) {}

  std::vector<Token> all() {
    std::vector<Token> tokens;
    while (skip(), !rest_.empty()) {
      if (rest_.front() == '"' || rest_.front() == '\'')
        tokens.push_back(text());
      else if (is_letter(rest_.front()))
        tokens.push_back(take(Token::Kind::word, run(0, [](char c) { return is_letter(c) || is_digit(c); })));
      else
        tokens.push_back(take(Token::Kind::sign, 1));
    }
    return tokens;
  }

 private:
  static constexpr std::size_t longest_text = 1000;  ///< gmsh cuts strings at 1023 and goes on behind

  static bool is_digit(char c) { return c >= '0' && c <= '9'; }
  static bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
  /// How many characters from there on are of this kind.
  template <class Is> std::size_t run(std::size_t from, const Is& is) const {
    std::size_t length = 0;
    while (from + length < rest_.size() && is(rest_[from + length])) ++length;
    return length;
  }

  Token take(Token::Kind kind, std::size_t length) {
    const Token token{kind, rest_.substr(0, length), line_};
    line_ += static_cast<int>(std::ranges::count(token.text, '\n'));
    rest_.remove_prefix(length);
    return token;
  }
  Token text() {
    const auto end = rest_.find(rest_.front(), 1);
    if (end == rest_.npos || end > longest_text)
      refuse(file_, {Token::Kind::none, "a string", line_},
             end == rest_.npos ? "has no end" : "has more than 1000 characters");
    Token token = take(Token::Kind::text, end + 1);
    token.text = token.text.substr(1, end - 1);
    return token;
  }
  /// Length of the number that comes next, 0 if none does.
  std::size_t number() const {
    std::size_t length = run(0, is_digit);
    const bool whole = length > 0;
    if (length < rest_.size() && rest_[length] == '.') {
      const std::size_t decimals = run(length + 1, is_digit);
      if (whole || decimals > 0) length += 1 + decimals;
    }
    if (length == 0) return 0;
    if (length < rest_.size() && (rest_[length] == 'e' || rest_[length] == 'E')) {
      const bool has_sign = length + 1 < rest_.size() && (rest_[length + 1] == '+' || rest_[length + 1] == '-');
      if (const std::size_t digits = run(length + 1 + has_sign, is_digit); digits > 0) length += 1 + has_sign + digits;
    }
    return length;
  }
  void skip() {
    for (;;) {
      std::size_t length = run(0, [](char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\f'; });
      if (length == 0 && rest_.starts_with("//")) length = run(0, [](char c) { return c != '\n'; });
      if (length == 0 && rest_.starts_with("/*"))
        length = rest_.find("*/", 2) == rest_.npos ? rest_.size() : rest_.find("*/", 2) + 2;
      if (length == 0) length = number();
      if (length == 0) return;
      take(Token::Kind::none, length);
    }
  }

  const fs::path& file_;
  std::string_view rest_;
  int line_ = 1;
};

class Reader {
 public:
  void script(const fs::path& file) {
    if (!read_.insert(file.lexically_normal()).second) return;
    std::ifstream stream(file, std::ios::binary);
    const std::string content{std::istreambuf_iterator<char>(stream), {}};
    for (std::size_t k = 0; k < content.size(); ++k)
      if (content[k] == '\0' || (content[k] == '\r' && content.substr(k + 1, 1) != "\n"))
        throw InputError(fmt::format("{}: no text, it has zeros or carriage returns within its lines", file.string()));
    const std::vector<Token> tokens = Tokens(file, content).all();
    for (std::size_t k = 0; k < tokens.size(); ++k) check(file, tokens, k);
  }
  /// Beside the file that was opened gmsh takes its options.
  void options_of(const fs::path& file) {
    if (fs::path options = file.string() + ".opt"; fs::exists(options)) script(options);
  }

 private:
  static bool is_sign(const std::vector<Token>& tokens, std::size_t k, std::string_view sign) {
    return k < tokens.size() && tokens[k].kind == Token::Kind::sign && tokens[k].text == sign;
  }

  void check(const fs::path& file, const std::vector<Token>& tokens, std::size_t k) {
    const Token& token = tokens[k];
    if (token.kind != Token::Kind::word) return;
    for (const auto& [command, what] : commands)
      if (token.text == command) refuse(file, token, what);
    // "Print.Format = ..." is an option.
    if (token.text == "Print" && !is_sign(tokens, k + 1, ".")) refuse(file, token, "writes a file");
    if (token.text == "Printf" || token.text == "Error" || token.text == "Warning") {
      std::size_t end = k + 1;
      for (int depth = 0; end < tokens.size() && !is_sign(tokens, end, ";"); ++end) {
        depth += is_sign(tokens, end, "(") - is_sign(tokens, end, ")");
        if (depth == 0 && is_sign(tokens, end, ">")) refuse(file, token, "writes a file");
      }
    }
    if (token.text == "Merge" || token.text == "MergeWithBoundingBox" || token.text == "Include" ||
        token.text == "ShapeFromFile")
      included(file, token, k + 1 + (is_sign(tokens, k + 1, "(") ? 1 : 0), tokens);
  }

  void included(const fs::path& file, const Token& command, std::size_t k, const std::vector<Token>& tokens) {
    if (k + 1 >= tokens.size() || tokens[k].kind != Token::Kind::text || tokens[k + 1].kind != Token::Kind::sign ||
        (tokens[k + 1].text != ";" && tokens[k + 1].text != ")"))
      refuse(file, command, "takes a file whose name is computed");
    const fs::path name = std::string(tokens[k].text);
    if (name.is_absolute() || std::ranges::find(name, fs::path("..")) != name.end())
      refuse(file, command, fmt::format("takes \"{}\", which is not below the folder of the script", name.string()));
    const std::string kind = lower_case(name.extension().string());
    constexpr std::array<std::string_view, 6> data{".step", ".stp", ".iges", ".igs", ".brep", ".stl"};
    const fs::path path = file.parent_path() / name;
    if (std::ranges::find(data, kind) != data.end() || !fs::exists(path)) return;
    script(path);
    options_of(path);
  }

  std::set<fs::path> read_;
};

}  // namespace

void require_harmless(const std::string& path) {
  Reader reader;
  reader.options_of(path);
  if (lower_case(fs::path(path).extension().string()) == ".geo") return reader.script(path);
  std::ifstream stream(path, std::ios::binary);
  std::string begin(12, ' ');
  stream.read(begin.data(), static_cast<std::streamsize>(begin.size()));
  for (const std::string_view known : {"$MeshFormat", "$Comments", "$NOD", "$ELM", "$PARA"})
    if (begin.starts_with(known)) return;
  throw InputError(fmt::format("{}: no gmsh mesh, expected $MeshFormat in the first line", path));
}

}  // namespace efree::internal
