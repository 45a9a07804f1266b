"""Messages of fast topics, which a timer takes: the executor does not see their subscriptions.

The EventsExecutor queues an event for each message, without bound and first in, first out. A node that is slower than
its topics would come to its timers and services later and later, and its memory would grow (1 GB/h was measured). Here
the queues of the middleware hold what waits. They drop their oldest messages without a word, which is counted.
"""

from collections import Counter
from collections.abc import Iterable, Iterator

from rclpy.subscription import Subscription


class Inbox:
    """Takes the messages of some topics, all that wait at once.

    A node has one, and leaves these subscriptions out of its property `subscriptions`, from which an executor reads.

    Args:
        depth: of the queue of each topic.
        topics: their full names.
    """

    def __init__(self, depth: int, topics: Iterable[str]) -> None:
        self.depth = depth
        self.overflows = 0
        """Full queues so far."""
        self._topics = frozenset(topics)

    def others(self, subscriptions: Iterable[Subscription]) -> Iterator[Subscription]:
        """The subscriptions to other topics, which an executor serves."""
        return (each for each in subscriptions if each.topic_name not in self._topics)

    def take(self, subscriptions: Iterable[Subscription]) -> list[str]:
        """Call back for the messages that wait, at most the depth of each queue.

        Returns:
            The topics whose queue was full: older messages are lost.
        """
        taken: Counter[str] = Counter()
        for each in list(subscriptions):
            if each.topic_name in self._topics:
                taken[each.topic_name] += self._taken(each)
        full = [topic for topic, count in taken.items() if count >= self.depth]
        self.overflows += len(full)
        return full

    def _taken(self, subscription: Subscription) -> int:
        with subscription.handle:
            for count in range(self.depth):
                found = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                if found is None:
                    return count
                subscription.callback(found[0])
        return self.depth
