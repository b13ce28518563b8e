"""Every value that a report embeds for its cursor against the log: values.py LOG PAGE. Needs mcap."""

import json
import re
import sys

from mcap.reader import make_reader

TOPICS = {"state": "/estim/state", "prediction": "/control/prediction", "reference": "/control/reference",
          "sent": "/tello/command", "estimate": "/estim/parameter"}
ROWS = {"state": ["x", "y", "z", "theta"], "sticks": ["roll", "pitch", "yaw", "throttle"],
        "parameters": ["lambda_h", "lambda_v", "lambda_a", "theta_0"]}

log = {}
with open(sys.argv[1], "rb") as file:
    for _, channel, message in make_reader(file).iter_messages(list(TOPICS.values())):
        log.setdefault(channel.topic, {})[message.log_time] = json.loads(message.data)

with open(sys.argv[2]) as file:
    figures = re.findall(r'<figure id="[^"]*-(\w+)"(.*?)</figure>', file.read(), re.DOTALL)


def sums(differences, unit):
    """Numbers stand in the page as integers less the one before."""
    total = 0
    for difference in differences:
        total += difference or 0
        yield None if difference is None else total / unit


compared, worst = 0, 0.0
for kind, figure in figures:
    script = re.search(r"<script[^>]*>(.*?)</script>", figure, re.DOTALL)
    data = json.loads(script.group(1)) if script and kind in ROWS else {"panels": []}
    for row, panel in zip(ROWS.get(kind, []), data["panels"]):
        for line in panel["lines"]:
            topic = log.get(TOPICS.get(line["name"]), {})
            for t_ms, value in zip(sums(data["time"], 1), sums(line["values"], 1e4)):
                if value is not None and t_ms * 1_000_000 in topic:
                    worst = max(worst, abs(value - topic[t_ms * 1_000_000][row]))
                    compared += 1
print(f"{compared} values compared, largest difference {worst:.2e} (half of the last digit is 5e-5)")
