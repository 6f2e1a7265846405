// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/case/expression.hpp"
#include "efree/core/error.hpp"
#include "efree/core/parallel.hpp"

#include <gtest/gtest.h>
#include <cmath>
#include <numbers>

namespace efree {
namespace {

/// Message of the InputError that `work` throws.
template <class Work> std::string complaint(const Work& work) {
  try {
    work();
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(Expression, EvaluatesTheUsualFunctions) {
  const Expressions<2> expressions;
  const Vec<2> x(0.7, -1.3);
  const auto value = [&](const char* text) { return expressions.field(text)(x); };
  EXPECT_DOUBLE_EQ(value("sin(pi*x) + y^2"), std::sin(std::numbers::pi * 0.7) + 1.69);
  EXPECT_DOUBLE_EQ(value("atan2(y, x)"), std::atan2(-1.3, 0.7));
  EXPECT_DOUBLE_EQ(value("sqrt(x) - abs(y)"), std::sqrt(0.7) - 1.3);
  EXPECT_DOUBLE_EQ(value("x > 0.5 ? 2 : 3"), 2.0);
  EXPECT_DOUBLE_EQ(value("log(e) + ln(e) + log10(100)"), 4.0);
  EXPECT_DOUBLE_EQ(value("-2^2"), -4.0);
  EXPECT_DOUBLE_EQ(value("1e-3"), 1e-3);
}

TEST(Expression, DefinitionsBuildOnEachOther) {
  Expressions<2> expressions;
  expressions.define("a", "2");
  expressions.define("r", "sqrt(x^2 + y^2)/a");
  expressions.define("unused", "1/0*x");
  expressions.define("q", "r^2");
  EXPECT_DOUBLE_EQ(expressions.field("q + a")(Vec<2>(3, 4)), 8.25);
  const Vec<2> pair = expressions.fields<2>({"q", "r*x"})(Vec<2>(3, 4));
  EXPECT_DOUBLE_EQ(pair[0], 6.25);
  EXPECT_DOUBLE_EQ(pair[1], 7.5);
}

TEST(Expression, FieldsThatAreNoTextHaveNames) {
  Expressions<2> expressions;
  expressions.define("half", "0.5");
  expressions.define("grey", [](const Vec<2>& x) { return 100.0 * x[0]; });
  expressions.define("unused", [](const Vec<2>&) -> double { throw InputError("asked for"); });
  expressions.define("density", "half*grey");
  EXPECT_DOUBLE_EQ(expressions.field("density + y")(Vec<2>(3, 4)), 154.0);
  EXPECT_TRUE(expressions.varies("density"));
  EXPECT_FALSE(expressions.varies("half"));
  EXPECT_EQ(complaint([&] { expressions.define("grey", "1", "case:3"); }),
            "case:3: \"grey\" already has a meaning, choose another name");
}

TEST(Expression, RefusedNamesSayWhy) {
  Expressions<2> expressions;
  expressions.refuse("grey", "there is no image");
  EXPECT_DOUBLE_EQ(expressions.field("2*x")(Vec<2>(3, 4)), 6.0);
  EXPECT_EQ(complaint([&] { expressions.field("2*grey", "case:3"); }),
            "case:3: expression \"2*grey\": there is no image");
  // Definitions may use it for others' sake.
  expressions.define("a", "grey + 1", "case:4");
  expressions.define("b", "2*a");
  EXPECT_EQ(complaint([&] { expressions.field("x + b", "case:5"); }),
            "case:5: expression \"x + b\": there is no image");
}

TEST(Expression, SaysWhereAndWhatIsWrong) {
  Expressions<2> expressions;
  EXPECT_EQ(complaint([&] { expressions.field("1 + foo*x", "case:3"); }),
            "case:3: expression \"1 + foo*x\", position 5: Unexpected token \"foo\" found");
  EXPECT_NE(complaint([&] { expressions.field("sin("); }).find("expression \"sin(\", position 5"), std::string::npos);
  EXPECT_NE(complaint([&] { expressions.field("1, 2"); }).find("2 values"), std::string::npos);
  EXPECT_EQ(complaint([&] { expressions.field("x = 1", "case:3"); }),
            "case:3: expression \"x = 1\", position 3: = has no meaning here, did you mean ==?");
  EXPECT_EQ(complaint([&] { expressions.field("(x <= 1) + (x >= 1) + (x == 1) + (x != 1)"); }), "no error");
  EXPECT_NE(complaint([&] { expressions.define("x", "1"); }).find("\"x\" already has a meaning"), std::string::npos);
  EXPECT_NE(complaint([&] { expressions.define("sin", "1"); }).find("already has a meaning"), std::string::npos);
  EXPECT_NE(complaint([&] { expressions.define("2a", "1"); }).find("\"2a\" cannot name"), std::string::npos);
}

TEST(Expression, RefusesValuesThatAreNotFinite) {
  const Expressions<2> expressions;
  const auto field = expressions.field("1/(x - 2)", "case:7");
  EXPECT_DOUBLE_EQ(field(Vec<2>(3, 0)), 1.0);
  EXPECT_EQ(complaint([&] { field(Vec<2>(2, 0.5)); }),
            "case:7: expression \"1/(x - 2)\" is inf at (2, 0.5), expected a finite number");
  EXPECT_NE(complaint([&] { expressions.field("0/0"); }).find("expected a finite number"), std::string::npos);
}

TEST(Expression, FieldsOfSeveralTimesAreThereAtOnce) {
  Expressions<2> expressions;
  expressions.define("half", "0.5");
  expressions.at_time(0.0);
  expressions.define("inverse", "half/t", "case:2");  // has no value at the time at which it is defined
  expressions.define("wave", "x + inverse");
  const auto at = [&](double time) { return expressions.at_another_time(time).field("wave + t", "case:3"); };
  const auto early = at(2.0), late = at(4.0);
  for (int k = 0; k < 2; ++k) {
    EXPECT_DOUBLE_EQ(early(Vec<2>(1, k)), 1.0 + 0.25 + 2.0);
    EXPECT_DOUBLE_EQ(late(Vec<2>(1, k)), 1.0 + 0.125 + 4.0);
  }
  EXPECT_DOUBLE_EQ(expressions.at_another_time(8.0).field("2*inverse")(Vec<2>::Zero()), 0.125);
  EXPECT_FALSE(expressions.varies("inverse")) << "it is the same everywhere";
  EXPECT_TRUE(expressions.uses("t", "wave"));
  EXPECT_FALSE(expressions.uses("t", "half"));
  EXPECT_EQ(complaint([&] { expressions.field("inverse", "case:4"); }),
            "case:4: expression \"inverse\" is inf at t = 0, expected a finite number");
  EXPECT_EQ(complaint([&] { expressions.field("wave", "case:4")(Vec<2>(1, 0.5)); }),
            "case:4: expression \"wave\" is inf at (1, 0.5), t = 0, expected a finite number");
  // What is defined later is not what was compiled before.
  Expressions<2> other = expressions.at_another_time(2.0);
  other.define("more", "1");
  EXPECT_DOUBLE_EQ(other.field("wave + more")(Vec<2>(1, 0)), 2.25);
}

TEST(Expression, ThreadsDoNotDisturbEachOther) {
  Expressions<2> expressions;
  expressions.define("s", "x + 2*y");
  const auto field = expressions.field("s*x - y");
  constexpr Index n = 20000;
  Vector values(n);
  const int before = num_threads();
  set_num_threads(4);
  parallel_for(n, [&](Index i) { values[i] = field(Vec<2>(i, 0.5 * i)); });
  set_num_threads(before);
  for (Index i = 0; i < n; ++i) ASSERT_EQ(values[i], 2.0 * i * i - 0.5 * i);
}

}  // namespace
}  // namespace efree
