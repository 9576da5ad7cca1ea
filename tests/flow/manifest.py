#!/usr/bin/env python3
"""manifest.py FILE STAGE=TASKS...: whether the Jobs of a Kubernetes manifest have what batch/v1 asks of an Indexed Job,
and are those of the stages. By PyYAML where it is installed, or else by a reader of the part of YAML that the template
uses."""
import json, re, sys


def scalar(text):
    text = text.strip()
    if text.startswith('"'):
        return json.loads(text)
    return int(text) if re.fullmatch(r"-?\d+", text) else text


def flow(text):
    """{a: b, c: [d, e]} with strings in double quotes, as JSON would have it."""
    token = re.compile(r'\s*("(?:\\.|[^"\\])*"|[{}\[\],]|:(?=\s)|[^{}\[\],:\s"]+(?:[^{}\[\],\s"]*[^{}\[\],:\s"])?)')
    tokens, at = [], 0
    while at < len(text.rstrip()):
        m = token.match(text, at)
        assert m, f"not YAML: {text!r} at {at}"
        tokens.append(m.group(1))
        at = m.end()

    def value():
        t = tokens.pop(0)
        if t == "{":
            out = {}
            while tokens[0] != "}":
                key = tokens.pop(0)
                assert tokens.pop(0) == ":", text
                assert key not in out, f"{key} is there twice"
                out[key] = value()
                if tokens[0] == ",":
                    tokens.pop(0)
            tokens.pop(0)
            return out
        if t == "[":
            out = []
            while tokens[0] != "]":
                out.append(value())
                if tokens[0] == ",":
                    tokens.pop(0)
            tokens.pop(0)
            return out
        return scalar(t)

    result = value()
    assert not tokens, f"something follows in {text!r}"
    return result


def block(lines):
    """Lines of (indent, text) to what they mean; takes them off the list."""
    indent = lines[0][0]
    if lines[0][1].startswith("- "):
        out = []
        while lines and lines[0][0] == indent and lines[0][1].startswith("- "):
            lines[0] = (indent + 2, lines[0][1][2:])
            out.append(block(lines))
        return out
    out = {}
    while lines and lines[0][0] == indent and not lines[0][1].startswith("- "):
        key, _, rest = lines.pop(0)[1].partition(":")
        assert key not in out, f"{key} is there twice"
        rest = rest.strip()
        if rest:
            out[key] = flow(rest) if rest[0] in "{[" else scalar(rest)
        else:
            out[key] = block(lines)
    return out


def read(path):
    text = open(path).read()
    try:
        import yaml
        return [d for d in yaml.safe_load_all(text) if d]
    except ImportError:
        documents = []
        for part in re.split(r"(?m)^---$", text):
            lines = [(len(l) - len(l.lstrip()), l.strip()) for l in part.splitlines() if l.strip()
                     and not l.lstrip().startswith("#")]
            if lines:
                documents.append(block(lines))
                assert not lines, f"left over: {lines[0]}"
        return documents


NAME = re.compile(r"[a-z0-9]([-a-z0-9]*[a-z0-9])?")


def check_pod(spec):
    assert spec["restartPolicy"] == "Never", "a pod failure policy wants restartPolicy Never"
    volumes = {v["name"] for v in spec["volumes"]}
    for c in spec["containers"]:
        assert NAME.fullmatch(c["name"]) and c["image"] and all(isinstance(w, str) for w in c["command"]), c
        for mount in c["volumeMounts"]:
            assert mount["name"] in volumes and mount["mountPath"].startswith("/"), mount
        for amounts in c.get("resources", {}).values():
            for amount in amounts.values():
                assert re.fullmatch(r"\d+(\.\d+)?(m|[KMGT]i?)?", str(amount)), amount
    return {c["name"] for c in spec["containers"]}


def check(job):
    assert (job["apiVersion"], job["kind"]) == ("batch/v1", "Job"), "not a Job"
    assert len(job["metadata"]["name"]) <= 63 and NAME.fullmatch(job["metadata"]["name"]), job["metadata"]["name"]
    spec = job["spec"]
    known = {"completionMode", "completions", "parallelism", "backoffLimitPerIndex", "podFailurePolicy", "template",
             "ttlSecondsAfterFinished"}
    assert set(spec) <= known, f"unknown: {set(spec) - known}"
    assert spec["completionMode"] == "Indexed" and spec["completions"] >= 1 \
        and 1 <= spec["parallelism"] <= spec["completions"]
    containers = check_pod(spec["template"]["spec"])
    for rule in spec["podFailurePolicy"]["rules"]:
        assert rule["action"] in ("Ignore", "Count", "FailIndex", "FailJob")
        assert ("onExitCodes" in rule) != ("onPodConditions" in rule), "a rule has one condition"
        if "onExitCodes" in rule:
            on = rule["onExitCodes"]
            assert on["containerName"] in containers and on["operator"] in ("In", "NotIn")
            assert 75 in on["values"] and 0 not in on["values"]
    return job["spec"]["template"]["metadata"]["labels"]["stage"], spec


jobs = dict(check(job) for job in read(sys.argv[1]))
wanted = {stage: int(tasks) for stage, tasks in (a.split("=") for a in sys.argv[2:])}
assert {stage: spec["completions"] for stage, spec in jobs.items()} == wanted, f"not {wanted}"
assert all(spec["parallelism"] <= 2 for spec in jobs.values())
print(f"{len(jobs)} jobs hold")
