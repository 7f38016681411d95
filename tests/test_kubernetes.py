"""The manifests of deploy/kubernetes, as kustomize renders them: in shape, and fitting together."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from jouleswarm.common.options import Started
from jouleswarm.common.scenario.reading import load_scenario

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "deploy" / "kubernetes"
VERSION = "1.32"
ROLE = "app.kubernetes.io/component"
OVERLAYS = ["quick", "toy"]
Manifest = dict[str, Any]


def rendered(name: str) -> list[Manifest]:
    """What `kubectl kustomize` makes of the few words of kustomization.yaml that are in use here.

    ConfigMaps have no hash after their names, and nothing the common label.
    """
    folder = FOLDER / name
    words = yaml.safe_load((folder / "kustomization.yaml").read_text())
    assert set(words) <= {
        "apiVersion",
        "kind",
        "namespace",
        "labels",
        "resources",
        "images",
        "replicas",
        "configMapGenerator",
    }
    found: list[Manifest] = []
    for resource in words["resources"]:
        path = folder / resource
        found += rendered(path.resolve().name) if path.is_dir() else list(yaml.safe_load_all(path.read_text()))
    for made in words["configMapGenerator"]:
        data = dict(literal.split("=", 1) for literal in made["literals"])
        if made.get("behavior") == "merge":
            named(found, "ConfigMap", made["name"])["data"] |= data
        else:
            found.append({"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": made["name"]}, "data": data})
    for count in words["replicas"]:
        named(found, "StatefulSet", count["name"])["spec"]["replicas"] = count["count"]
    for each in found:
        if each["kind"] != "Namespace":
            each["metadata"]["namespace"] = words["namespace"]
    return found


def named(manifests: list[Manifest], kind: str, name: str) -> Manifest:
    (found,) = (each for each in manifests if (each["kind"], each["metadata"]["name"]) == (kind, name))
    return found


def pods(manifests: list[Manifest]) -> Iterator[tuple[Manifest, Manifest]]:
    """Labels and specification of each workload's pods."""
    for each in manifests:
        if each["kind"] in ("StatefulSet", "Job"):
            yield each["spec"]["template"]["metadata"]["labels"], each["spec"]["template"]["spec"]


def containers(manifests: list[Manifest]) -> Iterator[Manifest]:
    for _, pod in pods(manifests):
        yield from (*pod["initContainers"], *pod["containers"])


def selectors(part: object) -> Iterator[dict[str, Any]]:
    """All selectors of pods in a manifest."""
    if isinstance(part, dict):
        for key, value in part.items():
            if key == "podSelector":
                yield value
            else:
                yield from selectors(value)
    elif isinstance(part, list):
        for value in part:
            yield from selectors(value)


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_every_manifest_has_the_shape_that_kubernetes_expects(overlay: str) -> None:
    manifests = [*rendered(overlay), yaml.safe_load((FOLDER / "results.yaml").read_text())]
    assert len(manifests) == 18
    for manifest in manifests:
        kubernetes_validate.validate(manifest, VERSION, strict=True)


def test_a_manifest_of_another_shape_is_found() -> None:
    broker = named(rendered("quick"), "StatefulSet", "broker")
    broker["spec"]["replica"] = 1
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broker, VERSION, strict=True)


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_pods_of_robots_are_numbered_as_the_scenarios_robots(overlay: str) -> None:
    robots = named(rendered(overlay), "StatefulSet", "agent")["spec"]
    first = robots["ordinals"]["start"]
    assert load_scenario(overlay).agents == tuple(range(first, first + robots["replicas"]))
    index = {"fieldRef": {"fieldPath": "metadata.labels['apps.kubernetes.io/pod-index']"}}
    (robot,) = robots["template"]["spec"]["containers"]
    assert {"name": "JOULESWARM_ID", "valueFrom": index} in robot["env"]


@pytest.mark.parametrize("overlay", OVERLAYS)
def test_the_scenario_is_one_that_the_image_has_and_a_file_of_ones_own_need_not_be_there(overlay: str) -> None:
    manifests = rendered(overlay)
    assert named(manifests, "ConfigMap", "settings")["data"] == {
        "JOULESWARM_SCENARIO": overlay, "JOULESWARM_SET": "", "JOULESWARM_BROKER": "mqtts://broker:8883",
        "JOULESWARM_KEYS": "/keys",
    }  # fmt: skip
    for labels, pod in pods(manifests):
        if labels[ROLE] != "broker":
            assert {"name": "scenario", "configMap": {"name": "scenario", "optional": True}} in pod["volumes"]
            assert pod["containers"][0]["envFrom"] == [{"configMapRef": {"name": "settings"}}]


def test_selectors_and_services_lead_to_pods_that_there_are() -> None:
    manifests = rendered("quick")
    roles = {labels[ROLE] for labels, _ in pods(manifests)}
    assert roles == {"broker", "recorder", "datacenter", "agent"}
    for each in manifests:
        if each["kind"] == "StatefulSet":
            assert each["spec"]["selector"]["matchLabels"] == each["spec"]["template"]["metadata"]["labels"]
            assert named(manifests, "Service", each["spec"]["serviceName"])
        if each["kind"] == "Service":
            assert each["spec"]["selector"][ROLE] == each["metadata"]["name"]
        if each["kind"] == "NetworkPolicy":
            for selector in selectors(each):
                meant = {selector[key][ROLE] for key in ("matchLabels",) if key in selector}
                meant |= {value for one in selector.get("matchExpressions", ()) for value in one["values"]}
                assert meant <= roles


def test_volumes_are_there_and_secrets_those_that_the_script_makes() -> None:
    manifests = rendered("quick")
    made = set(re.findall(r"^secret (\w+)", (ROOT / "deploy" / "secrets.sh").read_text(), re.MULTILINE))
    used = set()
    for each in manifests:
        if each["kind"] not in ("StatefulSet", "Job"):
            continue
        pod = each["spec"]["template"]["spec"]
        claimed = [claim["metadata"]["name"] for claim in each["spec"].get("volumeClaimTemplates", ())]
        there = {volume["name"] for volume in pod["volumes"]} | set(claimed)
        for container in (*pod["initContainers"], *pod["containers"]):
            assert {mount["name"] for mount in container.get("volumeMounts", ())} <= there
        for volume in pod["volumes"]:
            if "secret" in volume:
                used.add(volume["secret"]["secretName"].removeprefix("jouleswarm-keys-"))
            if "persistentVolumeClaim" in volume:
                assert named(manifests, "PersistentVolumeClaim", volume["persistentVolumeClaim"]["claimName"])
    assert used == made == {"broker", "recorder", "datacenter", "robots"}


def test_the_process_of_a_robot_sees_its_own_keys_only() -> None:
    pod = named(rendered("quick"), "StatefulSet", "agent")["spec"]["template"]["spec"]
    keys = pod["initContainers"][0]
    assert keys["command"] == ["tar", "-xzf", "/secret/keys.tar.gz", "-C", "/keys", "agent-$(JOULESWARM_ID)"]
    assert "secret" not in {mount["name"] for mount in pod["containers"][0]["volumeMounts"]}


def test_nobody_sends_before_the_recorder_listens() -> None:
    manifests = rendered("quick")
    waits = {
        labels[ROLE]: [each["command"][3:] for each in pod["initContainers"] if "deploy/wait_for.py" in each["command"]]
        for labels, pod in pods(manifests)
    }
    after = [["recorder", "9884"]]
    assert waits == {"broker": [], "recorder": [["broker", "8883"]], "datacenter": after, "agent": after}
    recorder = named(manifests, "Job", "recorder")["spec"]["template"]["spec"]["containers"][0]
    assert recorder["readinessProbe"]["exec"]["command"][-1] in recorder["command"][-1]


def test_a_container_has_limits_and_no_privileges() -> None:
    manifests = rendered("quick")
    for _, pod in pods(manifests):
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["enableServiceLinks"] is False  # else a Service's variables are taken for options
        assert pod["automountServiceAccountToken"] is False
    for container in containers(manifests):
        assert set(container["resources"]["limits"]) == {"cpu", "memory"}
        assert container["resources"]["requests"]["memory"] == container["resources"]["limits"]["memory"]
        assert container["securityContext"] == {
            "allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True, "capabilities": {"drop": ["ALL"]},
        }  # fmt: skip


def test_variables_are_those_that_the_processes_read() -> None:
    known = {f"JOULESWARM_{field.upper().rstrip('_')}" for field in Started.__dataclass_fields__}
    known |= {"JOULESWARM_ID", "JOULESWARM_METRICS_PORT", "JOULESWARM_METRICS_HOST"}
    known |= {"JOULESWARM_BROKER_HOST", "JOULESWARM_BROKER_STATE"}
    manifests = rendered("quick")
    used = set(named(manifests, "ConfigMap", "settings")["data"])
    used |= {variable["name"] for container in containers(manifests) for variable in container.get("env", ())}
    assert used <= known


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="no kubectl")
@pytest.mark.parametrize("overlay", OVERLAYS)
def test_kubectl_renders_the_same(overlay: str) -> None:
    done = subprocess.run(["kubectl", "kustomize", FOLDER / overlay], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    theirs = re.sub(r"settings-[a-z0-9]{10}", "settings", done.stdout)
    theirs = re.sub(r"image: jouleswarm:latest", "image: jouleswarm", theirs)
    found = list(yaml.safe_load_all(theirs))
    for each in found:
        assert each["metadata"]["labels"].pop("app.kubernetes.io/name") == "jouleswarm"
    assert by_name(found) == by_name(rendered(overlay))


def by_name(manifests: list[Manifest]) -> dict[tuple[str, str], Manifest]:
    for each in manifests:
        if not each["metadata"].get("labels", True):
            del each["metadata"]["labels"]
    return {(each["kind"], each["metadata"]["name"]): each for each in manifests}
