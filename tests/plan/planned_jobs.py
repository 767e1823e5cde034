"""Planned jobs of tests: their layers, and their lines as a controller reads them."""

import re

from lmctl.job.reader import JobReader

LINE = re.compile(
    r"N(?P<n>\d+) G1 X(?P<x>[-.\d]+) Y(?P<y>[-.\d]+)(?: Z(?P<z>[-.\d]+))?(?: F(?P<f>[.\d]+))?"
    r"(?: S(?P<s>[.\d]+))?")


def layers_of(path):
    with JobReader(path) as job:
        return job.manifest, list(job.iterate_layers())


def walk(layers):
    """Every line with what the controller makes of it: text, table row, modal z, feed, power."""
    z = feed = power = None
    for layer in layers:
        for text, row in zip(layer.program, layer.lines, strict=True):
            words = LINE.fullmatch(text)
            if words:
                z = words["z"] or z
                feed = words["f"] or feed
                power = words["s"] or power
            yield text, row, words, z, feed, power
