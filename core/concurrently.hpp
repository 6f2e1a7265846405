// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <functional>

namespace efree {

/// Runs serial work beside work that is spread over threads: `beside` on a thread of its own, where parallel_for runs
/// on that one alone, while work() runs on this one. One after the other, `beside` first, where there is but one
/// thread. Returns when both have ended. Neither may write what the other reads. An exception of work() is rethrown,
/// else one of `beside`.
void concurrently(const std::function<void()>& beside, const std::function<void()>& work);

}  // namespace efree
