// SPDX-License-Identifier: GPL-3.0-or-later
/// Iterations for several right-hand sides, which go on by themselves and use a matrix together.
#pragma once

#include "efree/assembly/internal/block_matrix.hpp"
#include "efree/solvers/linear/internal/coarse_solver.hpp"
#include "efree/solvers/linear/internal/smoother.hpp"

#include <algorithm>
#include <coroutine>
#include <exception>
#include <utility>
#include <vector>

namespace efree {

/// A coroutine that waits for products; begun as it is made.
class Iteration {
 public:
  struct promise_type {
    std::exception_ptr error{};

    Iteration get_return_object() { return Iteration(std::coroutine_handle<promise_type>::from_promise(*this)); }
    std::suspend_never initial_suspend() noexcept { return {}; }
    std::suspend_always final_suspend() noexcept { return {}; }
    void return_void() {}
    void unhandled_exception() { error = std::current_exception(); }
  };

  Iteration(Iteration&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Iteration& operator=(Iteration&&) = delete;
  ~Iteration() {
    if (handle_) handle_.destroy();
  }
  /// Throws what it has thrown.
  void check() const {
    if (handle_.promise().error) std::rethrow_exception(handle_.promise().error);
  }

 private:
  explicit Iteration(std::coroutine_handle<promise_type> handle) : handle_(handle) {}
  std::coroutine_handle<promise_type> handle_;
};

/// Products with a matrix, its smoother and coarse solutions for all iterations that have come to the same point: what
/// is stored is read once for them. Each gets what it would get alone but for rounding.
template <int Dim> class InStep {
  struct Request {
    const CoarseSolver<Dim>* coarse;  ///< if it is a solution by that
    int degree;                       ///< else of the smoother; 0: a product with the matrix
    const Points<Dim>* from;
    Points<Dim>* to;
    std::coroutine_handle<> who;
  };
  struct Waiting {
    InStep& all;
    Request request;

    bool await_ready() const noexcept { return false; }
    void await_suspend(std::coroutine_handle<> who) {
      request.who = who;
      all.requests_.push_back(request);
    }
    void await_resume() const noexcept {}
  };

 public:
  InStep(const BlockMatrix<Dim>& K, const Smoother<Dim>& smoother) : K_(K), smoother_(smoother) {}

  /// To be awaited: y = K x; x and y differ.
  Waiting multiply(const Points<Dim>& x, Points<Dim>& y) { return {*this, {nullptr, 0, &x, &y, {}}}; }
  /// To be awaited: Smoother::apply.
  Waiting smooth(int degree, const Points<Dim>& r, Points<Dim>& z) { return {*this, {nullptr, degree, &r, &z, {}}}; }
  /// To be awaited: CoarseSolver::solve.
  Waiting solve(const CoarseSolver<Dim>& coarse, const Points<Dim>& r, Points<Dim>& z) {
    return {*this, {&coarse, 0, &r, &z, {}}};
  }

  /// Goes on until none waits any more.
  void run() {
    while (!requests_.empty()) {
      std::vector<Request> now = std::exchange(requests_, {});
      const auto kind = [](const Request& one) { return std::pair(one.coarse, one.degree); };
      std::ranges::stable_sort(now, {}, kind);
      for (auto first = now.begin(), last = first; first != now.end(); first = last) {
        std::vector<const Points<Dim>*> from;
        std::vector<Points<Dim>*> to;
        for (; last != now.end() && kind(*last) == kind(*first); ++last)
          from.push_back(last->from), to.push_back(last->to);
        if (first->coarse) {
          auto solved = first->coarse->solve(from);
          for (std::size_t k = 0; k < to.size(); ++k) *to[k] = std::move(solved[k]);
        } else if (first->degree == 0) {
          K_.multiply(from, to);
        } else {
          smoother_.apply(K_, first->degree, from, to);
        }
      }
      for (const Request& request : now) request.who.resume();
    }
  }

 private:
  const BlockMatrix<Dim>& K_;
  const Smoother<Dim>& smoother_;
  std::vector<Request> requests_;
};

}  // namespace efree
