// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/expression.hpp"

#include "efree/core/error.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <muParser.h>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <regex>
#include <set>
#include <thread>
#include <utility>

namespace efree {
namespace {

std::string prefixed(const std::string& where, const std::string& message) {
  return where.empty() ? message : where + ": " + message;
}

[[noreturn]] void reject(const mu::Parser::exception_type& error, const std::string& text, const std::string& where) {
  const std::string& message = error.GetMsg();  // counts positions from 0, where it names them at all
  const std::size_t position = std::min(static_cast<std::size_t>(error.GetPos()), text.size()) + 1;
  throw InputError(prefixed(where, fmt::format("expression \"{}\", position {}: {}", text, position,
                                               message.substr(0, message.find(" at position")))));
}

template <int Dim> std::string coordinate(int i) {
  return std::string(1, "xyz"[i]);
}

/// muParser would assign: to definitions, even to x.
void refuse_assignment(const std::string& text, const std::string& where) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '=') continue;
    const bool doubled = i + 1 < text.size() && text[i + 1] == '=';
    if (!doubled && (i == 0 || std::string_view("<>!").find(text[i - 1]) == std::string_view::npos))
      throw InputError(prefixed(
          where, fmt::format("expression \"{}\", position {}: = has no meaning here, did you mean ==?", text, i + 1)));
    if (doubled) ++i;
  }
}

/// Compiled expressions and the named ones they use. Not to be shared between threads: muParser reads its variables
/// from fixed addresses.
template <int Dim> class Program {
 public:
  Program() = default;
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Compiles `text`, which later ones may call `name`.
  void define(const std::string& name, const std::string& text, const std::string& where) {
    Step step = compile(name, text, where);
    if (varies(step))
      steps_.push_back(std::move(step));
    else
      constants_[name] = evaluate(step);
  }
  /// A field that later ones may call `name`.
  void define(const std::string& name, const ScalarField<Dim>& given) {
    steps_.push_back({.name = name, .parser = {}, .given = given, .is_in_space = true});
  }
  /// The time, which later ones may call `name`.
  void define_time(const std::string& name) { steps_.push_back({.name = name, .parser = {}, .is_time = true}); }
  /// Why a text is refused that uses what is; empty: it does not.
  std::string reason_against(const std::string& text, const std::string& where) {
    return reason_against(parse("", text, where));
  }
  /// Expressions that use the name are refused for this reason.
  void refuse(const std::string& name, const std::string& why) { refused_[name] = why; }
  /// Compiles `text` as the next component of what the program computes.
  void add_result(const std::string& text, const std::string& where) { results_.push_back(compile("", text, where)); }

  /// Forgets the definitions that no result needs.
  void prune() {
    std::set<std::string> needed;
    const auto need = [&](const Step& step) {
      if (step.given || step.is_time) return;
      for (const auto& entry : step.parser.GetUsedVar()) needed.insert(entry.first);
    };
    for (const Step& result : results_) need(result);
    for (auto step = steps_.end(); step != steps_.begin();) {
      --step;
      if (needed.contains(step->name))
        need(*step);
      else
        step = steps_.erase(step);
    }
  }
  /// Whether there is a definition of that name, after those that no result needs were forgotten.
  bool has(const std::string& name) const { return std::ranges::find(steps_, name, &Step::name) != steps_.end(); }
  /// Whether the results depend on the position.
  bool varies() const { return std::ranges::any_of(results_, &Step::is_in_space); }

  /// Puts the components at x and a time into `values`.
  void operator()(const Vec<Dim>& x, double time, double* values) {
    for (int i = 0; i < Dim; ++i) at_[i] = x[i];
    const bool is_same_time = std::exchange(time_, time) == time;
    for (Step& step : steps_) {
      if (step.is_time)
        step.value = time;
      else if (step.is_in_space || !is_same_time)
        step.value = step.given ? step.given(x) : step.parser.Eval();
    }
    for (Step& result : results_) *values++ = result.parser.Eval();
  }

 private:
  struct Step {
    std::string name;
    mu::Parser parser;         ///< either this
    ScalarField<Dim> given{};  ///< or this
    bool is_time = false;      ///< or the time
    bool is_in_space = false;  ///< whether it depends on the position
    double value = 0.0;
  };

  Step compile(const std::string& name, const std::string& text, const std::string& where) {
    Step step = parse(name, text, where);
    if (const std::string why = reason_against(step); !why.empty())
      throw InputError(prefixed(where, fmt::format("expression \"{}\": {}", text, why)));
    return step;
  }
  /// Why what an expression uses is refused; empty: it is not.
  std::string reason_against(const Step& step) const {
    for (const auto& [name, why] : refused_)
      if (step.parser.GetUsedVar().contains(name)) return why;
    return {};
  }
  Step parse(const std::string& name, const std::string& text, const std::string& where) {
    refuse_assignment(text, where);
    Step step{.name = name, .parser = {}};
    try {
      step.parser.DefineConst("pi", std::numbers::pi);
      step.parser.DefineConst("e", std::numbers::e);
      for (const auto& [constant, value] : constants_) step.parser.DefineConst(constant, value);
      for (int i = 0; i < Dim; ++i) step.parser.DefineVar(coordinate<Dim>(i), &at_[i]);
      for (Step& earlier : steps_) step.parser.DefineVar(earlier.name, &earlier.value);
      for (const auto& [unknown, why] : refused_) step.parser.DefineVar(unknown, &nothing_);
      step.parser.SetExpr(text);
      step.parser.Eval();  // compiles; the value does not matter yet
    } catch (const mu::Parser::exception_type& error) {
      reject(error, text, where);
    }
    if (step.parser.GetNumResults() != 1)
      throw InputError(prefixed(where, fmt::format("expression \"{}\" has {} values separated by commas, expected one",
                                                   text, step.parser.GetNumResults())));
    for (const auto& [used, place] : step.parser.GetUsedVar()) {
      const auto earlier = std::ranges::find(steps_, used, &Step::name);
      step.is_in_space = step.is_in_space || earlier == steps_.end() || earlier->is_in_space;
    }
    return step;
  }
  static bool varies(const Step& step) { return !step.parser.GetUsedVar().empty(); }
  static double evaluate(const Step& step) { return step.parser.Eval(); }

  std::array<double, Dim> at_{};
  double time_ = std::numeric_limits<double>::quiet_NaN();  // of the values that do not depend on the position
  double nothing_ = 0.0;
  std::map<std::string, double> constants_;
  std::map<std::string, std::string> refused_;  // reasons by name
  std::list<Step> steps_;                       // a list, because values must not move once others refer to them
  std::vector<Step> results_;
};

/// Hands a program to each thread that evaluates: mostly the one it had before, without waiting for others.
template <int Dim> class Pool {
 public:
  explicit Pool(std::function<std::unique_ptr<Program<Dim>>()> make) : make_(std::move(make)) {}
  ~Pool() {
    for (auto& slot : slots_) delete slot.load();
  }
  Pool(const Pool&) = delete;
  Pool& operator=(const Pool&) = delete;

  void evaluate(const Vec<Dim>& x, double time, double* values) {
    auto& slot = slots_[std::hash<std::thread::id>{}(std::this_thread::get_id()) % slots_.size()];
    std::unique_ptr<Program<Dim>> program(slot.exchange(nullptr));
    if (!program) program = make_();
    (*program)(x, time, values);
    delete slot.exchange(program.release());
  }

 private:
  std::function<std::unique_ptr<Program<Dim>>()> make_;
  std::array<std::atomic<Program<Dim>*>, 61> slots_{};
};

/// What evaluates expressions that use definitions; without texts what knows all definitions.
template <int Dim, class Definitions, class Texts>
std::unique_ptr<Program<Dim>> program_of(const Definitions& definitions, const Texts& texts, const std::string& where) {
  auto program = std::make_unique<Program<Dim>>();
  for (const auto& [name, text, given, refused] : definitions) {
    if (!refused.empty())
      program->refuse(name, refused);
    else if (text.empty() && !given)
      program->define_time(name);
    else if (given)
      program->define(name, given);
    else
      program->define(name, text, where);
  }
  for (const std::string& text : texts) program->add_result(text, where);
  if (!texts.empty()) program->prune();
  return program;
}

}  // namespace

/// Programs by what they compute, at any time.
template <int Dim> struct Expressions<Dim>::Compiled {
  struct Entry {
    std::shared_ptr<Pool<Dim>> pool{};
    bool varies = false;  ///< with the position
  };

  template <std::size_t Size> Entry get(const std::vector<Definition>& definitions,
                                        const std::array<std::string, Size>& texts, const std::string& where) {
    const std::lock_guard lock(mutex);
    Entry& entry = all[fmt::format("{}\n{}\n{}", Size, where, fmt::join(texts, "\n"))];
    if (!entry.pool) {
      const auto make = [definitions, texts, where] { return program_of<Dim>(definitions, texts, where); };
      entry.varies = make()->varies();
      entry.pool = std::make_shared<Pool<Dim>>(make);
    }
    return entry;
  }

  std::mutex mutex{};
  std::map<std::string, Entry> all{};
};

template <int Dim> Expressions<Dim>::Expressions() : compiled_(std::make_shared<Compiled>()) {}

template <int Dim> void Expressions<Dim>::add(Definition definition) {
  definitions_.push_back(std::move(definition));
  compiled_ = std::make_shared<Compiled>();
}

template <int Dim> void Expressions<Dim>::require_free(const std::string& name, const std::string& where) const {
  static const std::regex identifier("[A-Za-z_][A-Za-z0-9_]*");
  if (!std::regex_match(name, identifier))
    throw InputError(
        prefixed(where, fmt::format("\"{}\" cannot name a definition, expected letters, digits and _", name)));
  bool taken = name == "pi" || name == "e" || mu::Parser().GetFunDef().contains(name);
  for (int i = 0; i < Dim; ++i) taken |= name == coordinate<Dim>(i);
  for (const Definition& earlier : definitions_) taken |= name == earlier.name;
  if (taken) throw InputError(prefixed(where, fmt::format("\"{}\" already has a meaning, choose another name", name)));
}

template <int Dim>
void Expressions<Dim>::define(const std::string& name, const std::string& text, const std::string& where) {
  require_free(name, where);
  // What uses a name that is refused may be there for those that do not refuse it.
  const std::string why =
      program_of<Dim>(definitions_, std::array<std::string, 0>{}, where)->reason_against(text, where);
  if (why.empty() && !(time_ && uses("t", text, where))) field(text, where);
  add({.name = name, .text = text, .refused = why});
}
template <int Dim> void Expressions<Dim>::define(const std::string& name, ScalarField<Dim> given) {
  require_free(name, {});
  add({.name = name, .given = std::move(given)});
}
template <int Dim> void Expressions<Dim>::at_time(double t) {
  require_free("t", {});
  add({.name = "t"});
  time_ = t;
}
template <int Dim> Expressions<Dim> Expressions<Dim>::at_another_time(double t) const {
  require(time_.has_value(), "expressions at another time: expected at_time() before");
  Expressions result = *this;
  result.time_ = t;
  return result;
}
template <int Dim> void Expressions<Dim>::at_any_time() {
  define("t", [](const Vec<Dim>& time) { return time[0]; });
  runs_ = true;
}
template <int Dim> void Expressions<Dim>::at_clock(std::shared_ptr<const double> clock) {
  define("t", [clock](const Vec<Dim>&) { return *clock; });
  clock_ = std::move(clock);
}
template <int Dim> void Expressions<Dim>::refuse(const std::string& name, const std::string& why) {
  require_free(name, {});
  add({.name = name, .refused = why});
}

template <int Dim> ScalarField<Dim> Expressions<Dim>::field(const std::string& text, const std::string& where) const {
  return [component = fields<1>({text}, where)](const Vec<Dim>& x) { return component(x)[0]; };
}

template <int Dim> bool Expressions<Dim>::varies(const std::string& text, const std::string& where) const {
  return program_of<Dim>(definitions_, std::array{text}, where)->varies();
}

template <int Dim>
bool Expressions<Dim>::uses(const std::string& name, const std::string& text, const std::string& where) const {
  return program_of<Dim>(definitions_, std::array{text}, where)->has(name);
}

template <int Dim> template <std::size_t Size>
std::function<Eigen::Matrix<double, static_cast<int>(Size), 1>(const Vec<Dim>&)> Expressions<Dim>::fields(
    const std::array<std::string, Size>& texts, const std::string& where) const {
  using Values = Eigen::Matrix<double, static_cast<int>(Size), 1>;
  const auto check = [texts, where, time = time_, runs = runs_, clock = clock_](const Values& values,
                                                                                const Vec<Dim>* x) {
    for (std::size_t k = 0; k < Size; ++k) {
      const double value = values[static_cast<int>(k)];
      if (std::isfinite(value)) continue;
      std::vector<std::string> at;
      if (x && runs)
        at.push_back(fmt::format("t = {:.6g}", (*x)[0]));
      else if (x)
        at.push_back(fmt::format("({})", fmt::join(*x, ", ")));
      if (time) at.push_back(fmt::format("t = {:.6g}", *time));
      if (clock) at.push_back(fmt::format("t = {:.6g}", *clock));
      throw InputError(prefixed(where, fmt::format("expression \"{}\" is {}{}{}, expected a finite number", texts[k],
                                                   std::isnan(value) ? std::abs(value) : value,
                                                   at.empty() ? "" : " at ", fmt::join(at, ", "))));
    }
  };
  const auto [pool, varies] = compiled_->get(definitions_, texts, where);
  const double time = time_.value_or(0.0);
  if (!varies) {
    Values values;
    pool->evaluate(Vec<Dim>::Zero(), time, values.data());
    check(values, nullptr);
    return [values](const Vec<Dim>&) { return values; };
  }
  return [pool = pool, time, check](const Vec<Dim>& x) {
    Values values;
    pool->evaluate(x, time, values.data());
    check(values, &x);
    return values;
  };
}

template class Expressions<2>;
template VectorField<2> Expressions<2>::fields(const std::array<std::string, 2>&, const std::string&) const;
template std::function<Vec<3>(const Vec<2>&)> Expressions<2>::fields(const std::array<std::string, 3>&,
                                                                     const std::string&) const;
template VoigtField<2> Expressions<2>::fields(const std::array<std::string, 4>&, const std::string&) const;
template std::function<Vec<6>(const Vec<2>&)> Expressions<2>::fields(const std::array<std::string, 6>&,
                                                                     const std::string&) const;
template class Expressions<3>;
template VectorField<3> Expressions<3>::fields(const std::array<std::string, 3>&, const std::string&) const;
template VoigtField<3> Expressions<3>::fields(const std::array<std::string, 6>&, const std::string&) const;

}  // namespace efree
