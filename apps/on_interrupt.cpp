// SPDX-License-Identifier: GPL-3.0-or-later
#include "on_interrupt.hpp"

#include <fcntl.h>
#include <unistd.h>
#include <atomic>
#include <cerrno>
#include <csignal>

namespace efree {
namespace {

constexpr int signals[] = {SIGINT, SIGTERM, SIGHUP};
std::atomic<int> to_watcher{-1};

void handle(int signal) {
  const int error = errno;
  const char byte = static_cast<char>(signal);
  [[maybe_unused]] const ssize_t written = write(to_watcher.load(), &byte, 1);
  errno = error;
}

void set_handlers(void (*from)(int), void (*to)(int)) {
  for (const int signal : signals) {
    struct sigaction action {};
    sigaction(signal, nullptr, &action);
    if (action.sa_handler != from) continue;
    action.sa_handler = to;
    action.sa_flags = SA_RESTART;
    sigaction(signal, &action, nullptr);
  }
}

}  // namespace

OnInterrupt::OnInterrupt(std::function<void()> clean_up) {
  if (pipe2(pipe_.data(), O_CLOEXEC) != 0) return;  // then a signal ends the program as ever
  to_watcher = pipe_[1];
  watcher_ = std::thread([clean_up = std::move(clean_up), from = pipe_[0]] {
    char signal = 0;
    if (read(from, &signal, 1) != 1) return;
    clean_up();
    std::signal(signal, SIG_DFL);
    kill(getpid(), signal);
  });
  set_handlers(SIG_DFL, handle);
}

OnInterrupt::~OnInterrupt() {
  if (!watcher_.joinable()) return;
  set_handlers(handle, SIG_DFL);
  to_watcher = -1;
  close(pipe_[1]);
  watcher_.join();
  close(pipe_[0]);
}

}  // namespace efree
