// SPDX-License-Identifier: GPL-3.0-or-later
/// What benchmarks are told on the command line.
#pragma once

#include <cstdlib>
#include <cstring>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace efree::bench {

using Keys = std::map<std::string, double>;

/// Numbers, and values of keys (key=value).
struct Arguments {
  std::vector<double> numbers;
  Keys keys;
};
/// From one argument on; `keys`: what they are where nothing is said.
inline Arguments arguments(int argc, char** argv, int first, Keys keys = {}) {
  Arguments result{{}, std::move(keys)};
  for (int i = first; i < argc; ++i)
    if (const char* equals = std::strchr(argv[i], '='))
      result.keys[std::string(argv[i], equals - argv[i])] = std::atof(equals + 1);
    else
      result.numbers.push_back(std::atof(argv[i]));
  return result;
}

}  // namespace efree::bench
