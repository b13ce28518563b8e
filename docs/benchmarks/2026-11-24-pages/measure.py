"""Time and values of a report in Chromium: measure.py LOG PAGE.

Opens PAGE (`tello-ctl report LOG --out PAGE`) by the browser's own protocol, moves the mouse over the figures of the
flight, zooms, and compares every label with LOG, read by the package mcap. Needs mcap and websockets.
"""

import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import urllib.request

import websockets
from mcap.reader import make_reader

TOPICS = {"state": "/estim/state", "prediction": "/control/prediction", "reference": "/control/reference"}
ROWS = {"state": ["x", "y", "z", "theta"], "sticks": ["roll", "pitch", "yaw", "throttle"]}
PARAMETERS = ["lambda_h", "lambda_v", "lambda_a", "theta_0"]
PORT = 9333


def read(path):
    log = {}
    with open(path, "rb") as file:
        topics = [*TOPICS.values(), "/tello/command", "/estim/parameter"]
        for _, channel, message in make_reader(file).iter_messages(topics):
            log.setdefault(channel.topic, {})[message.log_time // 10_000_000] = json.loads(message.data)
    return log


async def main(log_path, page):
    folder = tempfile.mkdtemp()
    browser = subprocess.Popen(
        ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--remote-debugging-port={PORT}",
         f"--user-data-dir={folder}", "about:blank"], stderr=subprocess.DEVNULL)
    try:
        for _ in range(100):
            try:
                targets = json.load(urllib.request.urlopen(f"http://127.0.0.1:{PORT}/json"))
                break
            except OSError:
                await asyncio.sleep(0.2)
        address = next(target for target in targets if target["type"] == "page")["webSocketDebuggerUrl"]
        async with websockets.connect(address, max_size=None) as socket:
            await drive(socket, log_path, page)
    finally:
        browser.terminate()
        browser.wait()


async def drive(socket, log_path, page):
    count = 0

    async def call(method, **parameters):
        nonlocal count
        count += 1
        await socket.send(json.dumps({"id": count, "method": method, "params": parameters}))
        while (answer := json.loads(await socket.recv())).get("id") != count:
            pass
        return answer["result"]

    async def value(script):
        result = await call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        return result["result"].get("value")

    await call("Emulation.setDeviceMetricsOverride", width=1280, height=800, deviceScaleFactor=1, mobile=False)
    await call("Performance.setTimeDomain", timeDomain="threadTicks")
    await call("Performance.enable")

    async def busy_s():
        metrics = (await call("Performance.getMetrics"))["metrics"]
        return next(metric["value"] for metric in metrics if metric["name"] == "TaskDuration")

    paints = []
    for _ in range(3):
        await call("Page.navigate", url="about:blank")
        before_s = await busy_s()
        await call("Page.navigate", url=f"file://{os.path.abspath(page)}")
        while await value("document.readyState") != "complete":
            await asyncio.sleep(0.05)
        await asyncio.sleep(1)
        paints.append(await value(
            "[performance.getEntriesByName('first-contentful-paint')[0].startTime,"
            " performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd]"))
        paints[-1].append(1e3 * (await busy_s() - before_s))
    print("first contentful paint, scripts done, processor time of the page's thread [s]:",
          [[round(t / 1e3, 2) for t in triple] for triple in paints])
    print(f"page {os.path.getsize(page) / 1e6:.2f} MB")

    log = read(log_path)
    compared, worst, moves = 0, 0.0, []
    for zoom in range(2):
        for step in range(4):
            box = await value(
                "(() => { const svg = document.querySelector('figure[id$=state] svg'); svg.scrollIntoView();"
                " const { left, top, width } = svg.getBoundingClientRect(); return [left, top, width]; })()")
            x = box[0] + box[2] * (0.12 + 0.2 * step)
            before_s = await busy_s()
            await call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=box[1] + 80)
            await value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            moves.append(1e3 * (await busy_s() - before_s))
            labels = json.loads(await value(
                "JSON.stringify([...document.querySelectorAll('figure')].map((figure) => [figure.id,"
                " [...figure.querySelectorAll('.values')].map((label) => label.textContent),"
                " [...figure.querySelectorAll('.cursor')].map((line) => [line.dataset.t, line.getBoundingClientRect().x])]))"))
            times, places = zip(*[cursor for _, _, lines in labels for cursor in lines])
            assert len(times) > 10 and len(set(times)) == 1 and max(places) - min(places) < 0.05, (times, places)
            for figure, texts, _ in labels:
                kind = figure.rsplit("-", 1)[-1]
                rows = PARAMETERS if kind == "parameters" else ROWS.get(kind, [])
                for row, text in zip(rows, texts):
                    tick = round(float(text.split(" ")[0]) * 100)
                    for name, shown in re.findall(r"; (\w+) (-?[\d.]+)", text):
                        topic = {"sticks": "/tello/command", "parameters": "/estim/parameter"}.get(kind, TOPICS.get(name))
                        if topic and name != "fault":
                            worst = max(worst, abs(float(shown) - log[topic][tick][row]))
                            compared += 1
        await value("document.querySelector('figure[id$=state] svg').dispatchEvent(new KeyboardEvent('keydown', { key: '+' }));"
                    " document.querySelector('figure[id$=state] svg').dispatchEvent(new KeyboardEvent('keydown', { key: '+' }))")
    print(f"{compared} values compared, largest difference {worst:.1e} (half a digit of the label is 5e-5)")
    print(f"a mouse move: {sorted(moves)[len(moves) // 2]:.0f} ms of processor time, median, {max(moves):.0f} largest")


asyncio.run(main(*sys.argv[1:]))
