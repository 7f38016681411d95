#!/bin/sh
# RabbitMQ as a cluster of three nodes on this machine, with its MQTT plugin, behind one port: HAProxy spreads the
# clients over the nodes that live. Run it as any user; nothing outside FOLDER is touched.
#
#   deploy/rabbitmq.sh start [FOLDER]      prints the URL to give to --broker when all three nodes are there
#   deploy/rabbitmq.sh kill N [FOLDER]     SIGKILL to node N, as a power failure does
#   deploy/rabbitmq.sh up N [FOLDER]       node N again; returns when it is there
#   deploy/rabbitmq.sh status [FOLDER]     the cluster, as it sees itself
#   deploy/rabbitmq.sh stop [FOLDER]       ends all, and removes FOLDER
#
# Needs Debian's packages rabbitmq-server (3.10 was tried) and haproxy. PORT (1884) is the balancer's; the nodes take the
# 15 ports from PORT + 1 on. Anybody may come in, from this machine only: it is for trying out.
set -eu
RABBIT="${RABBIT:-/usr/lib/rabbitmq/bin}"
WORD="${1:-}"
case "$WORD" in
kill | up) NODE="${2:?deploy/rabbitmq.sh $WORD N: which node, 1, 2 or 3}" FOLDER="${3:-}" ;;
*) FOLDER="${2:-}" ;;
esac
FOLDER="$(realpath -m "${FOLDER:-/tmp/jouleswarm-rabbitmq}")"
[ ! -r "$FOLDER/port" ] || PORT="$(cat "$FOLDER/port")"
PORT="${PORT:-1884}"
# Erlang's names of nodes and its cookie: of this cluster alone.
export HOME="$FOLDER" ERL_EPMD_ADDRESS=127.0.0.1 ERL_EPMD_PORT="$((PORT + 15))"

settings() { # node; sets the environment of the node's programs
  own="$FOLDER/$1"
  export RABBITMQ_NODENAME="node$1@localhost" RABBITMQ_PID_FILE="$own/pid" RABBITMQ_CONF_ENV_FILE=/dev/null
  export RABBITMQ_NODE_PORT="$((PORT + 3 + $1))" RABBITMQ_DIST_PORT="$((PORT + 6 + $1))"
  export RABBITMQ_MNESIA_BASE="$own/data" RABBITMQ_LOG_BASE="$own/log" RABBITMQ_CONFIG_FILE="$own/rabbitmq"
  export RABBITMQ_ENABLED_PLUGINS_FILE="$own/plugins" RABBITMQ_GENERATED_CONFIG_DIR="$own/generated"
  export RABBITMQ_SERVER_ADDITIONAL_ERL_ARGS="-kernel inet_dist_use_interface {127,0,0,1}"
}
run() { # node; starts it, and returns when it is there
  settings "$1"
  setsid "$RABBIT/rabbitmq-server" >"$own/printed" 2>&1 </dev/null &
  "$RABBIT/rabbitmqctl" --quiet wait --timeout 120 "$own/pid" >/dev/null
  "$RABBIT/rabbitmqctl" --quiet await_online_nodes "$2" --timeout 120
}
prepare() { # node
  settings "$1"
  mkdir -p "$own/data" "$own/log"
  echo '[rabbitmq_mqtt].' >"$own/plugins"
  cat >"$own/rabbitmq.conf" <<END
listeners.tcp.1 = 127.0.0.1:$RABBITMQ_NODE_PORT
mqtt.listeners.tcp.1 = 127.0.0.1:$((PORT + $1))
mqtt.allow_anonymous = true
mqtt.subscription_ttl = 600000
cluster_formation.peer_discovery_backend = classic_config
cluster_formation.classic_config.nodes.1 = node1@localhost
cluster_formation.classic_config.nodes.2 = node2@localhost
cluster_formation.classic_config.nodes.3 = node3@localhost
END
}
balance() {
  cat >"$FOLDER/haproxy.cfg" <<END
defaults
  mode tcp
  timeout connect 3s
  timeout client 1h
  timeout server 1h
  option redispatch
  retries 3
listen mqtt
  bind 127.0.0.1:$PORT
  balance roundrobin
  default-server check inter 500 fall 2 rise 2 on-marked-down shutdown-sessions
  server node1 127.0.0.1:$((PORT + 1))
  server node2 127.0.0.1:$((PORT + 2))
  server node3 127.0.0.1:$((PORT + 3))
END
  haproxy -D -q -f "$FOLDER/haproxy.cfg" -p "$FOLDER/haproxy.pid"
}
end() { # pid file
  [ ! -r "$1" ] || kill "$2" "$(cat "$1")" 2>/dev/null || true
}

PATH="$PATH:/usr/sbin"
case "$WORD" in
start)
  [ ! -e "$FOLDER" ] || { echo "rabbitmq: $FOLDER is there already; deploy/rabbitmq.sh stop $FOLDER" >&2; exit 2; }
  mkdir -m 700 -p "$FOLDER"
  echo "$PORT" >"$FOLDER/port"
  (umask 077 && head -c 24 /dev/urandom | base64 | tr -d '+/=' >"$FOLDER/.erlang.cookie" && chmod 400 "$FOLDER/.erlang.cookie")
  for node in 1 2 3; do prepare "$node"; done
  for node in 1 2 3; do run "$node" "$node"; done
  balance
  echo "mqtt://127.0.0.1:$PORT"
  ;;
kill) end "$FOLDER/$NODE/pid" -9 ;;
up) run "$NODE" 1 ;;
status) settings 1 && for node in 1 2 3; do settings "$node"; "$RABBIT/rabbitmqctl" cluster_status && break; done ;;
stop)
  end "$FOLDER/haproxy.pid" -15
  for node in 1 2 3; do end "$FOLDER/$node/pid" -9; done
  for _ in 1 2 3 4 5 6 7 8 9 10; do # the daemon of names stays until it has noticed that the nodes are gone
    epmd -kill 2>&1 | grep -q Killed && break || sleep 0.3
  done
  rm -rf "$FOLDER"
  ;;
*)
  sed -n '2,/^set/s/^# \{0,1\}//p' "$0"
  exit 2
  ;;
esac
