"""Reads the doctor's reports."""

import re

LINE = re.compile(r"^(ok|\?|WARN|ERROR)\s+(left image|right image|left camera_info|"
                  r"right camera_info|\S+)\s+(.*)$")
SUBJECTS_OF_NODE = ["left image", "right image", "left camera_info", "right camera_info", "stamps",
                    "images", "calibration", "baseline", "rectification", "disparity", "tf",
                    "speed", "clock"]
SUBJECTS = SUBJECTS_OF_NODE[:-3] + ["trigger", "shutter", "projector"] + SUBJECTS_OF_NODE[-3:]
SUBJECTS_WITH_IMU = SUBJECTS[:-2] + ["imu"] + SUBJECTS[-2:]


def parse(report):
    """Subject: (level, text with the hint)."""
    lines = {}
    for row in report.splitlines():
        match = LINE.match(row)
        if match:
            level, subject, text = match.groups()
            lines[subject] = (level, text)
        elif row.startswith(" ") and "-> " in row:
            level, text = lines[subject]
            lines[subject] = (level, text + " -> " + row.partition("-> ")[2])
    return lines


class ReportChecks:
    subjects = SUBJECTS

    def check(self, report, failed):
        """failed: {subject: (level, words, ...)}; all other lines must not have failed, but that
        about the speed of this computer, which may have other work."""
        lines = parse(report)
        self.assertEqual(list(lines), self.subjects, report)
        for subject, (level, text) in lines.items():
            if subject not in failed:
                if subject != "speed":
                    self.assertIn(level, ("ok", "?"), subject + ": " + text)
                continue
            self.assertEqual(level, failed[subject][0], subject + ": " + text)
            for words in failed[subject][1:]:
                self.assertIn(words, text)
            self.assertIn(" -> ", text, "a failed line has a hint")

    def check_result(self, result, failed):
        """The same of a run, which has nothing else to say and returns 1 if a line has failed."""
        self.assertEqual(result.stderr, "")
        self.check(result.stdout, failed)
        has_failed = any(level not in ("ok", "?") for level, _ in parse(result.stdout).values())
        self.assertEqual(result.returncode, int(has_failed), result.stdout)
