#include "odometry/state_archive.h"

#include "point_line_odometry/stereo_camera.h"

namespace point_line_odometry {

namespace {

/// Visits one element of every container and adds up the sizes of all members (FNV-1a, 64 bit).
class HashOfLayout {
 public:
  std::uint64_t hash() const { return hash_; }

 protected:
  void bytes(const void*, std::size_t size) { add(size); }
  std::size_t count(std::uint64_t) {
    add('*');
    return 1;
  }
  void mark(std::uint8_t num_members) { add('(' + 256U * num_members); }
  static void resize(const int*, cv::Mat*) {}

 private:
  void add(std::uint64_t value) {
    for (int i = 0; i < 8; ++i) hash_ = (hash_ ^ (value >> (8 * i) & 0xffU)) * 0x100000001b3U;
  }

  std::uint64_t hash_ = 0xcbf29ce484222325U;
};

/// Of the types of the state: another one means that a state of other members was saved.
std::uint64_t layoutOfState() {
  OdometryState state{StereoCamera()};
  StateArchive<HashOfLayout> archive;
  archive.visit(state);
  return archive.hash();
}

}  // namespace

std::string toBytes(OdometryState& state) {
  StateArchive<ToBytes> archive;
  std::uint64_t layout = layoutOfState();
  archive.visit(layout);
  archive.visit(state);
  return archive.take();
}

void fromBytes(const std::string& bytes, OdometryState* state) {
  StateArchive<FromBytes> archive(bytes);
  std::uint64_t layout = 0;
  archive.visit(layout);
  if (layout != layoutOfState()) {
    throw std::invalid_argument(
        "the state of the odometry was saved by a version of this package whose state has other "
        "members");
  }
  archive.visit(*state);
  archive.requireEnd();
}

}  // namespace point_line_odometry
