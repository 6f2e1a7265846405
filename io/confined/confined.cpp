// SPDX-License-Identifier: GPL-3.0-or-later
#include "efree/io/confined/internal/confined.hpp"

#include "efree/core/internal/reading_bound.hpp"
#include "efree/core/memory.hpp"
#include "efree/core/parallel.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <fstream>
#include <new>
#include <system_error>

#if defined(__SANITIZE_ADDRESS__)
constexpr bool sanitized = true;  // its shadow takes all addresses there are, and it reports on stderr
#else
constexpr bool sanitized = false;
#endif

namespace efree::internal {
namespace {

/// How the work went, the only byte that the child sends through its pipe. A child that sends none has died.
enum class Outcome : char { done = 'd', input_error = 'i', numerical_error = 'n', no_memory = 'm', other = 'o' };

bool in_child = false;  ///< set once, before the work begins

// Descriptors of the child.
constexpr int result_fd = 3, outcome_fd = 4, first_unused_fd = 5;

class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) close(fd_);
  }
  int operator*() const { return fd_; }

 private:
  int fd_;
};

// --- The child ------------------------------------------------------------------------------------------------------

constexpr std::uint32_t denied = SCMP_ACT_ERRNO(EPERM), unknown = SCMP_ACT_ERRNO(ENOSYS);

void allow_no_more_than_reading() {
  const auto must = [](int status) {
    if (status < 0)
      throw InputError(
          fmt::format("it cannot be read safely on this system, which has no seccomp ({}); --trust reads "
                      "it all the same",
                      std::strerror(-status)));
  };
  const scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ALLOW);
  must(filter ? 0 : -ENOMEM);
  const auto deny = [&](const char* name, const std::vector<scmp_arg_cmp>& when = {}, std::uint32_t action = denied) {
    const int call = seccomp_syscall_resolve_name(name);
    if (call == __NR_SCMP_ERROR) return;  // a call that libseccomp does not know, nor glibc then
    must(seccomp_rule_add_array(filter, action, call, static_cast<unsigned>(when.size()), when.data()));
  };
  // Programs, processes and the powers over them.
  for (const char* call : {"execve",
                           "execveat",
                           "fork",
                           "vfork",
                           "ptrace",
                           "process_vm_readv",
                           "process_vm_writev",
                           "process_madvise",
                           "pidfd_open",
                           "pidfd_getfd",
                           "pidfd_send_signal",
                           "kill",
                           "tkill",
                           "rt_sigqueueinfo",
                           "setpriority",
                           "sched_setscheduler",
                           "sched_setattr",
                           "setns",
                           "unshare",
                           "bpf",
                           "perf_event_open",
                           "userfaultfd",
                           "kcmp",
                           "keyctl",
                           "add_key",
                           "request_key"})
    deny(call);
  deny("clone", {SCMP_A0(SCMP_CMP_MASKED_EQ, CLONE_THREAD, 0)});
  deny("clone3", {}, unknown);  // its flags cannot be seen; the C library takes clone instead
  const auto self = static_cast<scmp_datum_t>(getpid());
  deny("tgkill", {SCMP_A0(SCMP_CMP_NE, self)});
  deny("rt_tgsigqueueinfo", {SCMP_A0(SCMP_CMP_NE, self)});
  deny("prlimit64", {SCMP_A0(SCMP_CMP_NE, 0)});
  deny("prlimit64", {SCMP_A1(SCMP_CMP_NE, RLIMIT_DATA), SCMP_A2(SCMP_CMP_NE, 0)});
  deny("setrlimit");
  // Files, but for reading them.
  constexpr scmp_datum_t writing[] = {O_WRONLY, O_RDWR, O_CREAT, O_TRUNC};
  for (const scmp_datum_t flag : writing) {
    deny("open", {SCMP_A1(SCMP_CMP_MASKED_EQ, flag, flag)});
    deny("openat", {SCMP_A2(SCMP_CMP_MASKED_EQ, flag, flag)});
  }
  deny("openat2", {}, unknown);
  deny("io_uring_setup", {}, unknown);
  for (const char* call : {"creat",     "truncate",    "rename",        "renameat",          "renameat2",
                           "unlink",    "unlinkat",    "mkdir",         "mkdirat",           "rmdir",
                           "link",      "linkat",      "symlink",       "symlinkat",         "mknod",
                           "mknodat",   "chmod",       "fchmod",        "fchmodat",          "fchmodat2",
                           "chown",     "fchown",      "lchown",        "fchownat",          "utime",
                           "utimes",    "utimensat",   "futimesat",     "setxattr",          "lsetxattr",
                           "fsetxattr", "removexattr", "lremovexattr",  "fremovexattr",      "mount",
                           "umount2",   "pivot_root",  "chroot",        "move_mount",        "fsopen",
                           "fsmount",   "open_tree",   "mount_setattr", "open_by_handle_at", "quotactl",
                           "swapon",    "swapoff",     "memfd_create"})
    deny(call);
  // Other ways out.
  for (const char* call : {"socket", "socketpair", "connect", "bind", "shmget", "shmat", "msgget", "semget", "mq_open",
                           "reboot", "kexec_load", "init_module", "finit_module", "delete_module"})
    deny(call);
  deny("ioctl", {SCMP_A1(SCMP_CMP_EQ, TIOCSTI)});
  deny("ioctl", {SCMP_A1(SCMP_CMP_EQ, TIOCLINUX)});
  must(seccomp_load(filter));
  seccomp_release(filter);
}

/// Whatever is written goes to the parent, and nothing stays behind should that die.
void leave_parent(int result, int outcome, pid_t parent) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPROF}) std::signal(signal, SIG_DFL);
  setsid();
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1);
  // Where memory is short it is this process that goes.
  std::ofstream("/proc/self/oom_score_adj") << 1000;
  const int in_high = fcntl(result, F_DUPFD, 64), out_high = fcntl(outcome, F_DUPFD, 64);
  dup2(in_high, result_fd);
  dup2(out_high, outcome_fd);
  close_range(first_unused_fd, ~0U, 0);
  const int nothing = open("/dev/null", O_RDWR);
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (!(sanitized && fd == STDERR_FILENO)) dup2(nothing, fd);
  close(nothing);
}

void limit_memory() {
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  const double available = available_memory();
  if (sanitized || !std::isfinite(available)) return;
  rlimit data{};
  getrlimit(RLIMIT_DATA, &data);
  data.rlim_cur = data.rlim_max = std::min(data.rlim_max, static_cast<rlim_t>(data_memory() + available));
  setrlimit(RLIMIT_DATA, &data);
  ReadingBound::own_process = true;
}

void put(int fd, const char* bytes, std::size_t n) {
  while (n > 0) {
    const ssize_t written = write(fd, bytes, n);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) throw std::bad_alloc();
    bytes += written;
    n -= static_cast<std::size_t>(written);
  }
}

[[noreturn]] void finish(Outcome outcome, const std::string& bytes) {
  try {
    put(result_fd, bytes.data(), bytes.size());
  } catch (const std::bad_alloc&) {
    outcome = Outcome::no_memory;
  }
  [[maybe_unused]] const ssize_t sent = write(outcome_fd, &outcome, 1);
  _exit(0);
}

struct Job {
  const std::function<std::string()>& work;
  int threads;
};

/// On a thread of its own: OpenMP keeps the threads of its teams by the thread that leads them, and those of the one
/// that called fork have stayed with the parent.
void* do_job(void* argument) {
  const Job& job = *static_cast<const Job*>(argument);
  set_num_threads(job.threads);
  try {
    finish(Outcome::done, job.work());
  } catch (const InputError& error) {
    finish(Outcome::input_error, error.what());
  } catch (const NumericalError& error) {
    finish(Outcome::numerical_error, error.what());
  } catch (const std::bad_alloc&) {
    finish(Outcome::no_memory, "");
  } catch (const std::exception& error) {
    finish(Outcome::other, error.what());
  } catch (...) {
    finish(Outcome::other, "for a reason it does not say");
  }
}

[[noreturn]] void be_child(const Confinement& confinement, int result, int outcome, pid_t parent, const Job& job) {
  in_child = true;
  ReadingTime::limited = !confinement.limits.seconds;
  leave_parent(result, outcome, parent);
  limit_memory();
  try {
    if (!confinement.limits.trust) allow_no_more_than_reading();
  } catch (const InputError& error) {
    finish(Outcome::input_error, fmt::format("{}: {}", confinement.subject, error.what()));
  }
  pthread_t thread{};
  pthread_attr_t attributes{};
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, std::size_t{64} << 20U);
  if (pthread_create(&thread, &attributes, do_job, const_cast<Job*>(&job)) != 0) finish(Outcome::no_memory, "");
  pthread_join(thread, nullptr);
  _exit(1);  // the thread does not return
}

// --- The parent -----------------------------------------------------------------------------------------------------

/// Ends the child, if nothing else does, when whoever waits for it goes.
class Child {
 public:
  explicit Child(pid_t pid) : pid_(pid) {}
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (pid_ < 0) return;
    kill(pid_, SIGKILL);
    wait();
  }
  /// Its status.
  int wait() {
    int status = 0;
    while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return status;
  }

 private:
  pid_t pid_;
};

/// The byte that the child sends; 0 if it died, -1 if the time was up before.
int await(int fd, double seconds, const std::function<void()>& watch) {
  constexpr double longest_wait = 0.1;
  using Clock = std::chrono::steady_clock;
  const auto end = Clock::now() + std::chrono::duration<double>(seconds);
  while (true) {
    const double left = std::chrono::duration<double>(end - Clock::now()).count();
    if (left <= 0.0) return -1;
    pollfd wanted{fd, POLLIN, 0};
    if (poll(&wanted, 1, static_cast<int>(1e3 * std::min(left, longest_wait)) + 1) <= 0) {
      if (watch) watch();
      continue;
    }
    char outcome = 0;
    const ssize_t got = read(fd, &outcome, 1);
    if (got < 0 && errno == EINTR) continue;
    return got == 1 ? outcome : 0;
  }
}

std::string contents(int fd) {
  struct stat status {};
  fstat(fd, &status);
  std::string bytes(static_cast<std::size_t>(status.st_size), '\0');
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t got = pread(fd, bytes.data() + done, bytes.size() - done, static_cast<off_t>(done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) throw std::bad_alloc();
    done += static_cast<std::size_t>(got);
  }
  return bytes;
}

[[noreturn]] void fail(const Confinement& confinement, const std::string& what) {
  throw InputError(fmt::format("{}: {} failed: {}", confinement.subject, confinement.reader, what));
}

/// The message, beginning with its subject unless it names it anyhow.
std::string about(const std::string& subject, std::string message) {
  return message.find(subject) != std::string::npos ? message : fmt::format("{}: {}", subject, message);
}

std::string cause_of_death(int status) {
  if (!WIFSIGNALED(status)) return fmt::format("it left with status {}", WEXITSTATUS(status));
  switch (WTERMSIG(status)) {
    case SIGSEGV:
    case SIGBUS:
      return "it used memory that is not its own";
    case SIGFPE:
      return "it divided by 0";
    case SIGABRT:
      return "it gave up";
    case SIGPROF:
      return "a file of this length should be read in less time: it is damaged, or so intricate that "
             "--mesh-time-limit has to say how many seconds it may take";
    case SIGKILL:
      return "it was killed, most likely for want of memory";
    default:
      return fmt::format("it was ended by signal {} ({})", WTERMSIG(status), strsignal(WTERMSIG(status)));
  }
}

}  // namespace

std::string run_confined(const Confinement& confinement, const std::function<std::string()>& work,
                         const std::function<void()>& watch) {
  if (in_child) return work();
  const auto need = [&](int status) {
    if (status < 0)
      fail(confinement, fmt::format("no process can be started for it: {}", std::generic_category().message(errno)));
    return status;
  };
  const Descriptor result(need(memfd_create("efree", MFD_CLOEXEC)));
  std::array<int, 2> ends{};
  need(pipe2(ends.data(), O_CLOEXEC));
  const Descriptor from_child(ends[0]);
  Descriptor to_parent(ends[1]);
  const Job job{work, num_threads()};
  const pid_t self = getpid();
  const pid_t pid = need(fork());
  if (pid == 0) be_child(confinement, *result, *to_parent, self, job);
  Child child(pid);
  { const Descriptor closed = std::move(to_parent); }
  constexpr double longest = 3600.0;
  const double seconds = confinement.limits.seconds.value_or(longest);
  const int outcome = await(*from_child, seconds, watch);
  if (outcome == -1) fail(confinement, fmt::format("it was not done after {:g} s (--mesh-time-limit)", seconds));
  const int status = child.wait();
  switch (static_cast<Outcome>(outcome)) {
    case Outcome::done:
      return contents(*result);
    case Outcome::input_error:
      throw InputError(about(confinement.subject, contents(*result)));
    case Outcome::numerical_error:
      throw NumericalError(contents(*result));
    case Outcome::no_memory:
      fail(confinement, "it needs more memory than there is");
    case Outcome::other:
      fail(confinement, contents(*result));
  }
  fail(confinement, cause_of_death(status));
}

}  // namespace efree::internal
