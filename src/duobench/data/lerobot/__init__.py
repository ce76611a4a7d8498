"""Export to LeRobot's data set formats v3.0 and v2.1, written here: without torch and LeRobot.

The formats are Parquet, MP4 and JSON. One Parquet file and one video a camera for each episode make
the export parallel, resumable and repairable episode by episode.
"""
