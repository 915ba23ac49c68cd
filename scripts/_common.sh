# Shared by the scripts in this folder, which source it. Bash.
# shellcheck shell=bash

package=point_line_odometry
repository=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
noetic=/opt/ros/noetic

# Where the scripts build: in the repository, unless that lies in a catkin workspace of its user, as
# rosrun looks for programs in all of a package's folder and would find each of them twice.
script_workspace() {
  local folder=$repository
  while [[ $folder == */*/* ]]; do
    folder=${folder%/*}
    [[ ${folder##*/} == src ]] || continue
    if [[ -e ${folder%/*}/.catkin_workspace || -e ${folder%/*}/.catkin_tools ]] ||
      grep -qs catkin "$folder/CMakeLists.txt"; then
      echo "${folder%/*}/.$package"
      return
    fi
  done
  echo "$repository/.workspace"
}
workspace=$(script_workspace)

# Says what begins, and how long the script has run: [min:s].
step() { printf '\n=== [%d:%02d] %s\n' $((SECONDS / 60)) $((SECONDS % 60)) "$*"; }

# Ends the script with a reason, one sentence, and exit code 2.
stop() {
  printf '%s: %s\n' "$(basename "$0")" "$*" >&2
  exit 2
}

# Sources a setup.bash, which may use variables that are not set, and would take our arguments.
source_setup() {
  local file=$1
  shift
  set +u
  # shellcheck disable=SC1090
  source "$file"
  set -u
}

# The environment in which everything is built and run: the distribution's programs first, and no
# other workspace, so that only this package's own libraries can be found.
use_ros() {
  unset CMAKE_PREFIX_PATH ROS_PACKAGE_PATH ROS_MASTER_URI ROS_NAMESPACE ROS_IP
  unset PYTHONPATH PYTHONHOME LD_LIBRARY_PATH PKG_CONFIG_PATH
  export PATH=/usr/bin:$PATH
  export ROS_HOSTNAME=localhost
  if [[ -f $noetic/setup.bash ]]; then source_setup "$noetic/setup.bash"; fi
}

# Uses a separate workspace from here on, for another kind of build: .workspace/NAME.
use_workspace() { workspace+=/$1; }

# Makes the package in the workspace: a folder with links to what the repository has. A link to the
# repository itself, in which the workspace lies, would be a loop for rosrun, which follows links,
# and show it the programs of every workspace.
link_package() {
  local folder=$workspace/src/$package entry name
  if [[ -L $folder ]]; then rm "$folder"; fi
  mkdir -p "$folder"
  find "$folder" -maxdepth 1 -xtype l -delete  # to what is no longer there
  for entry in "$repository"/*; do
    name=${entry##*/}
    if [[ $name == *.xml ]]; then
      cmp -s "$entry" "$folder/$name" || cp "$entry" "$folder"  # CMake would install the link
    elif [[ $(readlink "$folder/$name") != "$entry" ]]; then
      ln -sfn "$entry" "$folder/$name"
    fi
  done
}

# Sets `launcher`, CMake's option that compiles with ccache where it is installed. Another clone, and
# another workspace whose programs are built as deep below the repository, find what one has compiled.
use_ccache() {
  launcher=()
  if command -v ccache >/dev/null; then
    launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
    export CCACHE_BASEDIR=$repository CCACHE_NOHASHDIR=1
  fi
}

# Flags of scripts/fuzz and scripts/sanitize, and the compiler of the former, whose workspace the short
# form of the latter uses. What is left out are instructions for every access to a member, which
# double the time to compile; a bad pointer is found by AddressSanitizer anyway.
# shellcheck disable=SC2034
clang_options=(-DCMAKE_C_COMPILER=clang -DCMAKE_CXX_COMPILER=clang++ -DPOINT_LINE_ODOMETRY_FUZZ=ON)
address_flags='-fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=all'
address_flags+=' -fno-sanitize=alignment,null,object-size,vptr -D_GLIBCXX_ASSERTIONS'

# catkin_make in the workspace, which is made if need be; the arguments are catkin_make's.
catkin_in_workspace() {
  local options=(-DCMAKE_BUILD_TYPE=Release -DPYTHON_EXECUTABLE=/usr/bin/python3)
  options+=(-DCMAKE_EXPORT_COMPILE_COMMANDS=ON)  # for clang-tidy
  # Debian 11's GMock is not found any more when catkin runs CMake a second time.
  options+=(-DCMAKE_DISABLE_FIND_PACKAGE_GMock=ON)
  use_ccache
  options+=("${launcher[@]}")
  link_package
  # CMake refuses a build folder that has been moved or copied with the repository.
  local cache=$workspace/build/CMakeCache.txt
  if [[ -f $cache ]] && ! grep -qxF "CMAKE_HOME_DIRECTORY:INTERNAL=$workspace/src" "$cache"; then
    rm -rf "$workspace/build" "$workspace/devel" "$workspace/install"
  fi
  (cd "$workspace" && catkin_make "${options[@]}" "$@")
}
