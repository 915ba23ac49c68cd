#include "benchmark/memory_probe.h"

#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fstream>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <type_traits>

#include "point_line_odometry/stereo_odometry.h"

namespace point_line_odometry {
namespace {

/// What is sent before the pixels of the left and the right image.
struct FrameHeader {
  StereoCamera camera;
  std::int64_t stamp_ns = 0;
};
static_assert(std::is_trivially_copyable_v<FrameHeader>);

/// False if the other side has closed the socket.
bool sendBytes(int socket, const void* data, std::size_t size) {
  const char* next = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t sent = send(socket, next, size, MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) return false;
    next += sent;
    size -= static_cast<std::size_t>(sent);
  }
  return true;
}

/// False at the end.
bool receiveBytes(int socket, void* data, std::size_t size) {
  char* next = static_cast<char*>(data);
  while (size > 0) {
    const ssize_t received = recv(socket, next, size, 0);
    if (received < 0 && errno == EINTR) continue;
    if (received <= 0) return false;
    next += received;
    size -= static_cast<std::size_t>(received);
  }
  return true;
}

/// Of this process, as Linux counts.
MemoryUse memoryUse() {
  constexpr double kKilobytes = 1.0 / 1024.0;
  std::ifstream status("/proc/self/status");
  MemoryUse use;
  for (std::string name; status >> name;) {
    double value = 0.0;
    if (name == "VmHWM:" && status >> value) use.peak_MB = kKilobytes * value;
    if (name == "VmRSS:" && status >> value) use.resident_MB = kKilobytes * value;
    status.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
  }
  return use;
}

bool receiveImages(int socket, FrameHeader* header, StereoImages* images) {
  if (!receiveBytes(socket, header, sizeof(*header))) return false;
  images->stamp_ns = header->stamp_ns;
  for (cv::Mat* image : {&images->left, &images->right}) {
    image->create(header->camera.height, header->camera.width, CV_8UC1);
    if (!receiveBytes(socket, image->data, image->total())) return false;
  }
  return true;
}

void serve(int socket, const Parameters& parameters) {
  std::optional<StereoOdometry> odometry;
  FrameHeader header;
  StereoImages images;
  double peak_MB = 0.0;
  while (receiveImages(socket, &header, &images)) {
    if (!odometry) odometry.emplace(header.camera, parameters);
    odometry->process(images);
    MemoryUse use = memoryUse();
    // Linux counts pages per processor and adds them up later: its peak may sink by a few of them.
    use.peak_MB = peak_MB = std::max({peak_MB, use.peak_MB, use.resident_MB});
    if (!sendBytes(socket, &use, sizeof(use))) return;
  }
}

/// The other probes' sockets would keep them alive.
void closeAllBut(int socket) {
  constexpr int kFirst = 3;  // after stdin, stdout and stderr
  constexpr int kLast = 255;
  for (int other = kFirst; other <= kLast; ++other) {
    if (other != socket) close(other);
  }
}

}  // namespace

MemoryProbe::MemoryProbe(const Parameters& parameters) {
  int sockets[2];
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, sockets) != 0)
    throw std::system_error(errno, std::generic_category(), "socketpair");
  child_ = fork();
  if (child_ == 0) {
    int code = 0;
    closeAllBut(sockets[1]);
    try {
      serve(sockets[1], parameters);
    } catch (const std::exception&) {
      code = 1;
    }
    _exit(code);
  }
  socket_ = sockets[0];
  close(sockets[1]);
  if (child_ < 0) {
    close(socket_);
    throw std::system_error(errno, std::generic_category(), "fork");
  }
}

MemoryProbe::~MemoryProbe() {
  close(socket_);
  while (waitpid(child_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

MemoryUse MemoryProbe::process(const StereoCamera& camera, const StereoImages& images) {
  const FrameHeader header{camera, images.stamp_ns};
  bool alive = sendBytes(socket_, &header, sizeof(header));
  for (const cv::Mat* image : {&images.left, &images.right}) {
    const cv::Mat pixels = image->isContinuous() ? *image : image->clone();
    alive = alive && sendBytes(socket_, pixels.data, pixels.total());
  }
  MemoryUse use;
  if (!alive || !receiveBytes(socket_, &use, sizeof(use)))
    throw std::runtime_error("the process whose memory is measured has ended");
  return use;
}

}  // namespace point_line_odometry
