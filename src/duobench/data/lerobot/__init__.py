"""Export to LeRobot's data set format v3.0, written here: it needs neither torch nor LeRobot.

The format is Parquet, MP4 and JSON. One Parquet file and one video a camera for each episode make
the export parallel, resumable and repairable episode by episode.
"""
