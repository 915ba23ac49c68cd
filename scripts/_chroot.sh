# Shared by the scripts that run tests of the last commit in a fresh, minimal Debian: in a chroot
# that is made with debootstrap, and removed in the end however that comes. They source it, define
#   script, needed_gb   the path of the script, the space [GB] that it needs
#   take_arguments             sets release and chroot_name from the arguments that are its own
#   set_up                     installs in the chroot what is missing
#   test_in_chroot             its exit code is that of the script
# and call chroot_main "$@". Bash.
# shellcheck shell=bash
# Set by the scripts:
# shellcheck disable=SC2154
# shellcheck source=scripts/_common.sh
source "$(dirname "${BASH_SOURCE[0]}")/_common.sh"

# Takes --keep, --mirror and --help.
parse_arguments() {
  local own=()
  keep='' mirror=''
  while (($# > 0)); do
    case $1 in
      --keep | --mirror)
        [[ -n ${2:-} ]] || stop "$1 needs a value"
        printf -v "${1#--}" '%s' "$2"
        shift
        ;;
      -h | --help)
        sed -n '2,/^set/s/^# \{0,1\}//p' "$script"
        exit 0
        ;;
      *) own+=("$1") ;;
    esac
    shift
  done
  take_arguments "${own[@]}"
  [[ -z $mirror || $mirror == http*://* ]] || stop "--mirror $mirror is not a http(s) address"
}

# The same again as root, with what matters of the environment.
become_root() {
  local name kept=()
  command -v sudo >/dev/null || stop "needs root or sudo to make a chroot"
  for name in POINT_LINE_ODOMETRY_DATA TMPDIR TERM http_proxy https_proxy no_proxy; do
    if [[ -n ${!name:-} ]]; then kept+=("$name=${!name}"); fi
  done
  exec sudo env "${kept[@]}" "$script" "$@"
}

find_data() {
  data=$(dirname "$repository")/shared/data
  if [[ -n ${POINT_LINE_ODOMETRY_DATA:-} ]]; then
    data=$POINT_LINE_ODOMETRY_DATA
    [[ -d $data ]] || stop "POINT_LINE_ODOMETRY_DATA is not a folder: $data"
    data=$(realpath "$data")
  fi
  if [[ ! -d $data ]]; then data=''; fi
}

# Ends all that runs in the chroot, and with it its mounts, before anything is removed.
finish() {
  local code=$?
  trap - EXIT
  trap '' HUP INT QUIT PIPE TERM
  set +e
  if ((code > 128)); then echo "$(basename "$script"): interrupted, removing what was made" >&2; fi
  if [[ -n $lifeline ]]; then exec {lifeline}>&-; fi
  if [[ -n $namespace ]]; then wait "$namespace" 2>/dev/null; fi
  rm -rf --one-file-system ${scratch:+"$scratch"} ${root:+"$root.partial"}
  exit "$code"
}

make_folders() {
  local place free_gb
  place=$(realpath "${TMPDIR:-/var/tmp}")
  scratch=$(mktemp -d -p "$place" chroot.XXXXXX) || stop "cannot make a folder in $place"
  mkfifo "$scratch/lifeline"
  exec {lifeline}<>"$scratch/lifeline"
  if [[ -n $keep ]]; then
    mkdir -p "$keep" || stop "cannot make --keep $keep"
    place=$(realpath "$keep")
    exec {kept}<"$place"
    flock --nonblock "$kept" || stop "another run uses --keep $keep: wait for it to end"
    root=$place/$chroot_name
  else
    root=$scratch/$chroot_name
  fi
  free_gb=$(($(df --output=avail --block-size=1000000 "$place" | tail -n 1) / 1000))
  ((free_gb >= needed_gb)) || [[ -d $root ]] ||
    stop "$place has $free_gb GB of free space, $needed_gb GB are needed: choose another folder" \
      "with ${keep:+--keep or }TMPDIR"
}

# Git that reads the repository of another user, and none of the settings of this one.
plain_git() { HOME=$scratch git "$@"; }

# The last commit, as a repository of its own.
take_commit() {
  local changes
  command -v git >/dev/null || stop "needs git"
  unset "${!GIT_@}"
  plain_git config --global --add safe.directory '*'
  plain_git -C "$repository" rev-parse --verify HEAD >/dev/null 2>&1 ||
    stop "$repository is not a git repository with a commit"
  plain_git init --quiet --bare "$scratch/commit.git" 2>/dev/null
  plain_git -C "$scratch/commit.git" fetch --quiet --depth 1 "$repository" HEAD:refs/heads/tested ||
    stop "cannot copy the last commit of $repository"
  step "Testing on $chroot_name: $(plain_git -C "$repository" log -1 --format='%h %s')"
  changes=$(plain_git -C "$repository" --no-optional-locks status --short)
  if [[ -n $changes ]]; then printf 'not tested: uncommitted changes\n%s\n' "$changes"; fi
}

install_tools() {
  local missing=() reason
  command -v debootstrap >/dev/null || missing+=(debootstrap gpgv)
  [[ -f /usr/share/keyrings/debian-archive-keyring.gpg ]] || missing+=(debian-archive-keyring)
  if ((${#missing[@]} > 0)); then
    command -v apt-get >/dev/null || stop "needs debootstrap and Debian's keys: ${missing[*]}"
    step "Installing ${missing[*]}"
    apt-get --quiet update </dev/null
    DEBIAN_FRONTEND=noninteractive apt-get --quiet --yes install --no-install-recommends \
      "${missing[@]}" </dev/null || stop "cannot install ${missing[*]}"
  fi
  reason=$(unshare --mount --pid --fork --mount-proc true 2>&1) ||
    stop "root may not mount here, as in most containers ($reason): use a virtual machine, or a" \
      "privileged container"
}

# The proxy of apt is also used for wget, with which debootstrap downloads.
use_apt_proxy() {
  local proxy=''
  command -v apt-config >/dev/null || return 0
  eval "$(apt-config shell proxy Acquire::http::Proxy)"
  if [[ -z ${http_proxy:-} && $proxy == http* ]]; then
    export http_proxy=$proxy https_proxy=${https_proxy:-$proxy}
  fi
}

apt_mirror() {
  command -v apt-get >/dev/null || return 0
  # shellcheck disable=SC2016
  apt-get indextargets --format '$(ORIGIN) $(LABEL) $(REPO_URI)' 'Created-By: Packages' |
    sed -n 's|^Debian Debian \(https\{0,1\}://.*[^/]\)/*$|\1|p'
}

# Old releases move from the mirrors to the archive.
find_mirror() {
  local candidates=("$mirror") url
  if [[ -z $mirror ]]; then
    mapfile -t candidates < <({
      apt_mirror
      printf '%s\n' {http,https}://deb.debian.org/debian http://archive.debian.org/debian
    } | awk '!seen[$0]++')
  fi
  for url in "${candidates[@]}"; do
    if wget --quiet --spider --tries=2 --timeout=20 "$url/dists/$release/InRelease"; then
      mirror=$url
      return
    fi
  done
  stop "$release is at none of these mirrors, or they cannot be reached: ${candidates[*]};" \
    "name another with --mirror"
}

# In a session, a mount and a process namespace of its own, which end when this script does.
run_in_namespace() {
  local code=0
  set -m  # otherwise SIGINT would be ignored in there
  setsid --wait unshare --mount --pid --fork --kill-child --mount-proc \
    "$script" --inside "$release" "$chroot_name" "$root" "$mirror" "$scratch" "$data" \
    <"$scratch/lifeline" {lifeline}>&- &
  namespace=$!
  set +m
  wait "$namespace" || code=$?
  namespace=''
  return "$code"
}

# The first process of the namespace: when it ends, so do all others. Its stdin is the lifeline,
# which ends with the script outside.
inside() {
  release=$1 chroot_name=$2 root=$3 mirror=$4 scratch=$5 data=$6
  set -m
  run_tests </dev/null &
  cat >/dev/null &
  set +m
  wait -n
}

# A chroot counts as made when everything is installed.
run_tests() {
  local made=$root
  # Temporary folders are often mounted without devices or programs.
  mount --bind "${root%/*}" "${root%/*}"
  mount -o remount,bind,dev,exec,suid "${root%/*}"
  if [[ ! -d $root ]]; then
    root+=.partial
    make_chroot
  fi
  configure_chroot
  mount_folders
  check_out
  step "Setting up $chroot_name"
  set_up || stop "$chroot_name cannot be set up, for the reason above"
  if [[ $root != "$made" ]]; then mv "$root" "$made"; fi
  root=$made
  test_in_chroot
}

make_chroot() {
  local like=()
  step "Making a minimal Debian $release from $mirror"
  rm -rf --one-file-system "$root"  # of a run that was killed
  if [[ ! -e /usr/share/debootstrap/scripts/$release ]]; then like=(sid); fi
  debootstrap --variant=minbase --include=ca-certificates,git "$release" "$root" "$mirror" \
    "${like[@]}" ||
    stop "debootstrap cannot make a $release, for the reason above; if that is a key, install a" \
      "newer debian-archive-keyring: https://packages.debian.org/sid/debian-archive-keyring"
}

configure_chroot() {
  cp --dereference --remove-destination /etc/hosts /etc/resolv.conf "$root/etc"
  echo "deb $mirror $release main" >"$root/etc/apt/sources.list"
  printf '#!/bin/sh\nexit 101\n' >"$root/usr/sbin/policy-rc.d"  # starts no daemons
  chmod +x "$root/usr/sbin/policy-rc.d"
}

mount_folders() {
  mount -t proc proc "$root/proc"
  mount -t sysfs -o ro sysfs "$root/sys"
  mount --rbind /dev "$root/dev"
  mount -t tmpfs tmpfs "$root/dev/shm"
  if [[ -n $data ]]; then
    mount --bind "$data" "$root/mnt"
    mount -o remount,bind,ro "$root/mnt"
  fi
}

check_out() {
  local clone=$root/root/$package
  step "Cloning the repository"
  plain_git init --quiet "$clone" 2>/dev/null
  plain_git -C "$clone" fetch --quiet --depth 1 "$scratch/commit.git" tested
  plain_git -C "$clone" checkout --quiet --force --detach FETCH_HEAD
  plain_git -C "$clone" clean --quiet --force -d
}

in_chroot() {
  local name kept=()
  for name in TERM http_proxy https_proxy no_proxy; do
    if [[ -n ${!name:-} ]]; then kept+=("$name=${!name}"); fi
  done
  # shellcheck disable=SC2016
  chroot "$root" env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    ${data:+POINT_LINE_ODOMETRY_DATA=/mnt} "${kept[@]}" \
    bash -c 'cd ~/"$0" && exec "$@"' "$package" "$@"
}

chroot_main() {
  export PATH=$PATH:/usr/sbin:/sbin
  if [[ ${1:-} == --inside ]]; then
    inside "${@:2}"
    exit
  fi
  parse_arguments "$@"
  ((EUID == 0)) || become_root "$@"
  find_data
  scratch='' root='' lifeline='' namespace=''
  trap finish EXIT
  trap 'exit 129' HUP
  trap 'exit 130' INT
  trap 'exit 131' QUIT
  trap 'exit 141' PIPE
  trap 'exit 143' TERM
  make_folders
  take_commit
  install_tools
  use_apt_proxy
  find_mirror
  run_in_namespace
}
