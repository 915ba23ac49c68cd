#include "tools/report_script.h"

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <filesystem>
#include <system_error>

namespace point_line_odometry {

std::string makeReport(const std::string& folder) {
  std::error_code no_link;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", no_link);
  std::string script = (program.parent_path() / "report_run").string();
  std::string absolute = std::filesystem::absolute(folder).string();
  const std::array<char*, 3> arguments = {script.data(), absolute.data(), nullptr};
  pid_t child = 0;
  const int error =
      posix_spawn(&child, script.c_str(), nullptr, nullptr, arguments.data(), environ);
  if (error != 0) {
    return "cannot start " + script + " (" + std::generic_category().message(error) +
           "): it is installed beside this program, and needs python3";
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) return "report_run has gone";
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return "";
  return "report_run failed; once that is mended: report_run " + absolute;
}

}  // namespace point_line_odometry
