// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/files/child_process.hpp"

#include <sys/wait.h>
#include <unistd.h>
#include <array>

namespace efree {

int run_program(const std::filesystem::path& folder, std::vector<std::string> command, std::string* output) {
  std::vector<char*> arguments;
  for (std::string& word : command) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  std::array<int, 2> channel{};
  if (pipe(channel.data()) != 0) return 127;
  const pid_t child = fork();
  if (child == 0) {
    // Only calls that are safe between fork and exec in a program with threads.
    if (chdir(folder.c_str()) != 0) _exit(127);
    dup2(channel[1], STDOUT_FILENO);
    dup2(channel[1], STDERR_FILENO);
    close(channel[0]);
    close(channel[1]);
    execvp(arguments[0], arguments.data());
    _exit(127);
  }
  close(channel[1]);
  std::array<char, 4096> buffer{};
  for (ssize_t got; (got = read(channel[0], buffer.data(), buffer.size())) > 0;)
    if (output) output->append(buffer.data(), static_cast<std::size_t>(got));
  close(channel[0]);
  int status = 0;
  if (child < 0 || waitpid(child, &status, 0) != child) return 127;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace efree
