#!/bin/sh
# What Compose's containers survive: a deployment that nobody disturbs; one in which a robot, the data center and the
# broker are killed and started again, and a robot's network is taken away for a while; one that is broken off three
# times, as Ctrl-C does and as a power failure does, the last time while its robots leave, and is started again. All
# must end with the same rounds and the same weights to the bit.
#
#   deploy/faults.sh                                         the toy scenario, in a few minutes
#   COMPOSE_FILE=docker-compose.yml deploy/faults.sh         the paper's 12 robots, as JOULESWARM_SCENARIO says
#
# Needs docker compose, python3 and the built image (docker compose build). Its own project, removed at the end.
set -eu
cd "$(dirname "$0")/.."
export COMPOSE_FILE="${COMPOSE_FILE:-docker-compose.yml:deploy/toy.compose.yml}"
export COMPOSE_PROJECT_NAME=jouleswarm-faults
export JOULESWARM_METRICS_PORT="${JOULESWARM_METRICS_PORT:-0}"
# Robots may be away for longer than in a run that nobody disturbs; none reaches the target, so that there is time.
export JOULESWARM_SET="${JOULESWARM_SET:-federation.target_reward=1000 federation.max_rounds=150 meta.t0=60}
bus.connect_timeout_s=600 bus.resend_after_s=3"
OUT="${OUT:-runs/compose-faults}"
ROBOT="${ROBOT:-agent-2}" OTHER="${OTHER:-agent-4}" PAUSE_S="${PAUSE_S:-5}"

say() { echo "faults: $*"; }
fail() { # what has happened
  mkdir -p "$OUT"
  docker compose logs --no-color >"$OUT/failed.log" 2>&1
  say "$*, see $OUT/failed.log"
  exit 1
}
end() { docker compose down --volumes --timeout 1 >/dev/null 2>&1; }
trap end EXIT INT TERM

rows() { # how many rows of a phase the recorder has written
  docker compose exec -T recorder sh -c "cat /runs/*/*/rounds.jsonl 2>/dev/null" | grep -c "\"phase\":\"$1\"" || true
}
wait_for() { # phase, rows
  while [ "$(rows "$1")" -lt "$2" ]; do
    [ -n "$(docker compose ps -q --status running recorder)" ] || fail "the recorder has ended"
    sleep 0.5
  done
}
nearly() { # how many rows are left when it is time
  all=$(cat "$OUT"/undisturbed/*/*/rounds.jsonl | grep -c '"phase":"fl"')
  while [ "$(rows fl)" -lt "$((all - $1))" ] && [ -n "$(docker compose ps -q --status running recorder)" ]; do sleep 0.2; done
}
again() { # service
  say "killing $1, starting it again"
  docker compose kill -s SIGKILL "$1" >/dev/null 2>&1
  sleep "$PAUSE_S"
  docker compose start "$1" >/dev/null 2>&1
}
break_off() { # how: stop or kill
  say "breaking everything off: $1, then up again"
  if [ "$1" = stop ]; then docker compose stop >/dev/null 2>&1; else docker compose kill >/dev/null 2>&1; fi
  docker compose up -d >/dev/null 2>&1 || fail "up again"
}
finish() { # name
  code=$(docker wait "$(docker compose ps -aq recorder)")
  mkdir -p "$OUT/$1"
  docker compose cp recorder:/runs/. "$OUT/$1" >/dev/null 2>&1
  docker compose logs --no-color >"$OUT/$1/containers.log" 2>&1
  [ "$code" = 0 ] || fail "the recorder ended with code $code"
  end
}

rm -rf "$OUT"
say "undisturbed"
docker compose up -d >/dev/null 2>&1
finish undisturbed

say "disturbed"
docker compose up -d >/dev/null 2>&1
wait_for maml 10
again "$ROBOT"
wait_for maml 30
again datacenter
wait_for maml 60
again broker
wait_for fl 40
again "$ROBOT"
wait_for fl 100
say "taking $OTHER off its network for $PAUSE_S s"
network="${COMPOSE_PROJECT_NAME}_bus" container="$(docker compose ps -q "$OTHER")"
docker network disconnect "$network" "$container"
sleep "$PAUSE_S"
docker network connect --alias "$OTHER" "$network" "$container"
wait_for fl 200
again broker
finish disturbed

say "broken off"
docker compose up -d >/dev/null 2>&1
wait_for maml 30
break_off stop
wait_for fl 100
break_off kill
nearly 4
break_off stop
finish broken-off

python3 deploy/identical.py "$OUT/undisturbed" "$OUT/disturbed" "$OUT/broken-off"
