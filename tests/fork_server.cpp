// SPDX-License-Identifier: GPL-3.0-or-later
// Preloaded into a program (LD_PRELOAD), runs its main in a process of its own for every command that arrives on
// standard input, so that its libraries are loaded once: scripts/fuzz, after the fork server of AFL (Zalewski 2014).
// Everything else is the program's own.
//
// A command is a folder to run in, the arguments from the first one on, and an empty string, each ended by a NUL. What
// the run says goes to FOLDER.stdout and FOLDER.stderr. Two lines come back: its process id, then, when it has ended,
// its status as wait(2) has it. EFREE_FORK_ADDRESSES limits the addresses of a run, in bytes.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

namespace {

using Main = int (*)(int, char**, char**);
Main program = nullptr;

[[noreturn]] void give_up(const char* why) {
  std::perror(why);
  std::_Exit(1);
}

/// The strings up to the next empty one; none at the end of the commands.
std::vector<std::string> next_command() {
  std::vector<std::string> command(1);
  for (int c = std::getchar(); c != EOF; c = std::getchar()) {
    if (c != 0)
      command.back() += static_cast<char>(c);
    else if (command.back().empty())
      break;
    else
      command.emplace_back();
  }
  command.pop_back();
  return command;
}

void redirect(const std::string& file, int mode, int to) {
  const int fd = open(file.c_str(), mode | O_CLOEXEC, 0644);
  if (fd < 0 || dup2(fd, to) < 0) give_up(file.c_str());
}

void limit(const char* addresses) {
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  if (addresses == nullptr) return;
  const rlim_t most = std::strtoull(addresses, nullptr, 10);
  const rlimit bound{most, most};
  if (setrlimit(RLIMIT_AS, &bound) != 0) give_up("the limit of addresses");
}

int run(const std::vector<std::string>& command, char* name, char** environment) {
  const std::string& folder = command.front();
  constexpr int create = O_WRONLY | O_CREAT | O_TRUNC;
  redirect("/dev/null", O_RDONLY, STDIN_FILENO);
  redirect(folder + ".stdout", create, STDOUT_FILENO);
  redirect(folder + ".stderr", create, STDERR_FILENO);
  if (chdir(folder.c_str()) != 0) give_up(folder.c_str());
  limit(std::getenv("EFREE_FORK_ADDRESSES"));
  unsetenv("EFREE_FORK_ADDRESSES");
  std::vector<char*> arguments{name};
  for (std::size_t k = 1; k < command.size(); ++k) arguments.push_back(const_cast<char*>(command[k].c_str()));
  arguments.push_back(nullptr);
  return program(static_cast<int>(arguments.size()) - 1, arguments.data(), environment);
}

int serve(int, char** argv, char** environment) {
  unsetenv("LD_PRELOAD");  // what the program starts is itself again
  const std::filesystem::directory_iterator threads("/proc/self/task");
  if (std::distance(begin(threads), end(threads)) != 1) {
    std::fputs("the libraries start threads, which fork would leave behind\n", stderr);
    return 1;
  }
  for (auto command = next_command(); !command.empty(); command = next_command()) {
    const pid_t pid = fork();
    if (pid < 0) give_up("fork");
    if (pid == 0) return run(command, argv[0], environment);  // and leaves as the program does
    std::printf("%d\n", pid);
    std::fflush(stdout);
    int status = 0;
    if (waitpid(pid, &status, 0) != pid) give_up("waitpid");
    std::printf("%d\n", status);
    std::fflush(stdout);
  }
  std::_Exit(0);
}

}  // namespace

/// The C library's, which calls main when all libraries are there.
extern "C" int __libc_start_main(Main main, int argc, char** argv, void (*init)(), void (*fini)(), void (*rtld_fini)(),
                                 void* stack_end) {
  using Start = int (*)(Main, int, char**, void (*)(), void (*)(), void (*)(), void*);
  const auto start = reinterpret_cast<Start>(dlsym(RTLD_NEXT, "__libc_start_main"));
  if (start == nullptr) give_up("__libc_start_main");
  program = main;
  return start(serve, argc, argv, init, fini, rtld_fini, stack_end);
}
