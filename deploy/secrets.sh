#!/bin/sh
# Hands a folder of keys to a cluster: a secret for each role, a tar file of the folders of keys that it needs. ca.key
# stays here.
#
#   jouleswarm keys init quick --out keys --hosts broker,localhost,127.0.0.1
#   deploy/secrets.sh keys swarm           docker secret create jouleswarm-keys-ROLE
#   deploy/secrets.sh keys kubernetes      prints them: | kubectl apply -f -
#
# Robots share one, and each container takes its own folder out of it before its process begins, which cannot read the
# secret. A robot adds about 2 kB: a secret of Swarm holds 500 kB, one of Kubernetes 1 MiB.
set -eu
[ $# = 2 ] && [ -d "$1/broker" ] || { echo "usage: deploy/secrets.sh KEYS swarm|kubernetes, KEYS made by 'jouleswarm keys init'" >&2; exit 2; }
keys=$1 cluster=$2
work=$(mktemp -d) && chmod 700 "$work" && trap 'rm -rf "$work"' EXIT

secret() { # role, folders of keys
  role=$1 && shift
  tar -C "$keys" -czf "$work/keys.tar.gz" "$@"
  case $cluster in
  swarm) docker secret create "jouleswarm-keys-$role" "$work/keys.tar.gz" ;;
  kubernetes)
    kubectl create secret generic "jouleswarm-keys-$role" --namespace jouleswarm --from-file="$work/keys.tar.gz" \
      --dry-run=client --output yaml
    echo --- ;;
  *) echo "got $cluster, expected swarm or kubernetes" >&2; exit 2 ;;
  esac
}

secret broker broker health
secret recorder recorder
secret datacenter datacenter
# shellcheck disable=SC2046  # names without blanks
secret robots $(cd "$keys" && echo agent-*)
