// SPDX-License-Identifier: GPL-3.0-or-later
#include "virtual_display.hpp"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <array>
#include <csignal>
#include <cstdlib>
#include <string>

namespace efree {

VirtualDisplay::VirtualDisplay() {
  std::array<int, 2> channel{};
  if (pipe(channel.data()) != 0) return;
  const pid_t parent = getpid();
  server_ = fork();
  if (server_ == 0) {
    // Whatever ends this program, its alarm included, must not leave the server behind.
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(1);
    close(channel[0]);
    const int nowhere = open("/dev/null", O_RDWR);
    for (const int stream : {0, 1, 2}) dup2(nowhere, stream);
    const std::string number = std::to_string(channel[1]);
    execlp("Xvfb", "Xvfb", "-displayfd", number.c_str(), "-screen", "0", "1600x1200x24", "-nolisten", "tcp", nullptr);
    _exit(127);
  }
  close(channel[1]);
  std::array<char, 32> name{':'};
  ssize_t length = 1;
  for (ssize_t got; length < 31 && (got = read(channel[0], name.data() + length, 1)) == 1 && name[length] != '\n';
       ++length) {
  }
  close(channel[0]);
  name[static_cast<std::size_t>(length)] = '\0';
  started_ = length > 1;
  if (started_) setenv("DISPLAY", name.data(), 1);
}

VirtualDisplay::~VirtualDisplay() {
  if (server_ <= 0) return;
  kill(server_, SIGTERM);
  waitpid(server_, nullptr, 0);
}

}  // namespace efree
