// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/expression.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <muParser.h>
#include <array>
#include <cmath>
#include <list>
#include <memory>
#include <mutex>
#include <numbers>
#include <regex>
#include <set>

namespace efree {
namespace {

std::string prefixed(const std::string& where, const std::string& message) {
  return where.empty() ? message : where + ": " + message;
}

[[noreturn]] void reject(const mu::Parser::exception_type& error, const std::string& text, const std::string& where) {
  const std::string& message = error.GetMsg();  // counts positions from 0, where it names them at all
  throw InputError(prefixed(where, fmt::format("expression \"{}\", position {}: {}", text, error.GetPos() + 1,
                                               message.substr(0, message.find(" at position")))));
}

template <int Dim> std::string coordinate(int i) {
  return std::string(1, "xyz"[i]);
}

/// Parsers for the names an expression uses, in order, and for the expression itself. Not to be shared between threads:
/// muParser reads its variables from fixed addresses.
template <int Dim> class Program {
 public:
  Program() = default;
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Compiles `text`; afterwards it can be used as `name` if that is not empty.
  void add(const std::string& name, const std::string& text, const std::string& where) {
    Step& step = steps_.emplace_back();
    try {
      for (int i = 0; i < Dim; ++i) step.parser.DefineVar(coordinate<Dim>(i), &at_[i]);
      step.parser.DefineConst("pi", std::numbers::pi);
      step.parser.DefineConst("e", std::numbers::e);
      for (Step& earlier : steps_)
        if (&earlier != &step) step.parser.DefineVar(earlier.name, &earlier.value);
      step.name = name;
      step.parser.SetExpr(text);
      step.parser.Eval();  // compiles; the value does not matter yet
    } catch (const mu::Parser::exception_type& error) {
      reject(error, text, where);
    }
    if (step.parser.GetNumResults() != 1)
      throw InputError(prefixed(where, fmt::format("expression \"{}\" has {} values separated by commas, expected one",
                                                   text, step.parser.GetNumResults())));
  }

  double operator()(const Vec<Dim>& x) {
    for (int i = 0; i < Dim; ++i) at_[i] = x[i];
    for (Step& step : steps_) step.value = step.parser.Eval();
    return steps_.back().value;
  }

  /// Forgets the steps that the last one does not need. Returns whether what is left depends on position.
  bool prune() {
    std::set<std::string> needed{steps_.back().name};
    for (auto step = steps_.end(); step != steps_.begin();) {
      --step;
      if (needed.contains(step->name))
        for (const auto& entry : step->parser.GetUsedVar()) needed.insert(entry.first);
      else
        step = steps_.erase(step);
    }
    for (int i = 0; i < Dim; ++i)
      if (needed.contains(coordinate<Dim>(i))) return true;
    return false;
  }

 private:
  struct Step {
    mu::Parser parser;
    std::string name;
    double value = 0.0;
  };
  std::array<double, Dim> at_{};
  std::list<Step> steps_;  // a list, because values must not move
};

/// One program per thread that is evaluating at the moment.
template <int Dim> class Pool {
 public:
  explicit Pool(std::function<std::unique_ptr<Program<Dim>>()> make) : make_(std::move(make)) {}

  double evaluate(const Vec<Dim>& x) {
    auto program = take();
    const double value = (*program)(x);
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(program));
    return value;
  }

 private:
  std::unique_ptr<Program<Dim>> take() {
    {
      const std::lock_guard lock(mutex_);
      if (!idle_.empty()) {
        auto program = std::move(idle_.back());
        idle_.pop_back();
        return program;
      }
    }
    return make_();
  }

  std::function<std::unique_ptr<Program<Dim>>()> make_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Program<Dim>>> idle_;
};

}  // namespace

template <int Dim>
void Expressions<Dim>::define(const std::string& name, const std::string& text, const std::string& where) {
  static const std::regex identifier("[A-Za-z_][A-Za-z0-9_]*");
  if (!std::regex_match(name, identifier))
    throw InputError(
        prefixed(where, fmt::format("\"{}\" cannot name a definition, expected letters, digits and _", name)));
  bool taken = name == "pi" || name == "e" || mu::Parser().GetFunDef().contains(name);
  for (int i = 0; i < Dim; ++i) taken |= name == coordinate<Dim>(i);
  for (const Definition& earlier : definitions_) taken |= name == earlier.name;
  if (taken) throw InputError(prefixed(where, fmt::format("\"{}\" already has a meaning, choose another name", name)));
  field(text, where);
  definitions_.push_back({name, text});
}

template <int Dim> ScalarField<Dim> Expressions<Dim>::field(const std::string& text, const std::string& where) const {
  const auto make = [definitions = definitions_, text, where] {
    auto program = std::make_unique<Program<Dim>>();
    for (const Definition& definition : definitions) program->add(definition.name, definition.text, where);
    program->add("", text, where);
    program->prune();
    return program;
  };
  const auto checked = [text, where](double value, const Vec<Dim>& x) {
    if (!std::isfinite(value)) {
      std::string point;
      for (int i = 0; i < Dim; ++i) point += fmt::format("{}{}", i ? ", " : "", x[i]);
      throw InputError(prefixed(
          where, fmt::format("expression \"{}\" is {} at ({}), expected a finite number", text, value, point)));
    }
    return value;
  };
  if (const auto program = make(); !program->prune()) {
    const double value = checked((*program)(Vec<Dim>::Zero()), Vec<Dim>::Zero());
    return [value](const Vec<Dim>&) { return value; };
  }
  return
      [pool = std::make_shared<Pool<Dim>>(make), checked](const Vec<Dim>& x) { return checked(pool->evaluate(x), x); };
}

template class Expressions<2>;

}  // namespace efree
